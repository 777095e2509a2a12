// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <fstream>
#include <initializer_list>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace rangecal {

/// The bytes of a file of at most `most_bytes`. Throws InputError naming the file if it is missing, a folder, a device, a
/// pipe that nobody writes to, longer, or cannot be read.
std::string read_file(const std::string& path, std::size_t most_bytes = std::size_t{1} << 30);

/// A file under a name of its own, beside the one that it will have, until it is whole; removed unless it is put in place. For what
/// is written piece by piece; write_file() writes a text. Throws InputError naming the file where it cannot be written.
class PartialFile {
 public:
  explicit PartialFile(std::string path);
  PartialFile(PartialFile&& other) noexcept;
  ~PartialFile();

  void write(std::string_view bytes);
  /// Nothing more is written.
  void close();
  /// Gives it its name, in the place of a file that has it.
  void put_in_place();
  const std::string& path() const { return path_; }
  /// Its name until then.
  const std::string& partial_path() const { return own_; }

 private:
  [[noreturn]] void fail(const std::string& reason) const;

  std::string path_, own_;
  std::ofstream stream_;
};

/// Writes the text to a temporary beside `path` and renames it, so that the file is there whole or not at all;
/// a pipe or a device is written to. Throws InputError naming the file if it cannot be written.
void write_file(const std::string& path, const std::string& text);

/// Throws as `write_file` would if `path` cannot be written, before work of which it would take the result
/// begins; leaves nothing behind. An empty path asks for nothing. Also throws for a table of a recording that
/// exists: measurements are not replaced by a result.
void require_writable(const std::string& path);
/// The same of several, no two of which may be one file.
void require_writable(std::initializer_list<std::string> paths);

/// The same for what is written as a PartialFile, piece by piece: throws, too, for a pipe or a device, whose place it would
/// take.
void require_place_for_file(const std::string& path);

/// Throws InputError where one of `outputs` is the same file as one of `inputs`: of one name, or through links, where the
/// file or its name would be taken by a result. Empty paths, files that are not there yet, pipes and devices are none.
void require_apart(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs);

/// Throws InputError where two of `inputs` are the same file, also through links: it would count twice.
void require_distinct(const std::vector<std::string>& inputs);

/// Several files of a folder, names and texts: all are written to temporaries before the first is renamed, so that a disk
/// that is full leaves the folder as it was. Throws InputError naming the file.
void write_files(const std::string& folder, const std::vector<std::pair<std::string, std::string>>& files);

/// Writes all of the text to an open descriptor. Returns 0, or the errno of what stopped it on the way.
int write_all(int descriptor, std::string_view text);

/// Creates the folder (and those above it). Throws InputError if it cannot.
void make_folder(const std::string& path);

/// True if a file of that name exists.
bool file_exists(const std::string& path);

}  // namespace rangecal
