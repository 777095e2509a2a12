// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/files.hpp"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "io/input_file.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal {
namespace {

/// No two threads share one.
std::string next_number() {
  static std::atomic<unsigned long> count{0};
  return std::to_string(count++);
}

/// A terminal, a device or a pipe: nothing can be put in its place.
bool is_stream(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::is_other(path, ignored) || std::filesystem::is_character_file(path, ignored) ||
         std::filesystem::is_fifo(path, ignored);
}

/// What tells a file from all others, whatever it is called; nothing where there is none of that name.
using FileIdentity = std::pair<dev_t, ino_t>;

std::optional<FileIdentity> identity_of(const std::string& path) {
  struct stat status {};
  if (path.empty() || ::stat(path.c_str(), &status) != 0) return std::nullopt;
  return FileIdentity{status.st_dev, status.st_ino};
}

}  // namespace

PartialFile::PartialFile(std::string path)
    : path_(std::move(path)),
      own_(path_ + ".partial" + std::to_string(::getpid()) + "-" + next_number()),
      stream_(own_, std::ios::binary | std::ios::trunc) {
  if (!stream_) fail(std::strerror(errno));
}

PartialFile::PartialFile(PartialFile&& other) noexcept
    : path_(std::move(other.path_)), own_(std::exchange(other.own_, "")), stream_(std::move(other.stream_)) {}

PartialFile::~PartialFile() {
  std::error_code ignored;
  if (!own_.empty()) std::filesystem::remove(own_, ignored);
}

void PartialFile::write(std::string_view bytes) {
  if (!stream_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()))) fail(std::strerror(errno));
}

void PartialFile::close() {
  if (!stream_.is_open()) return;
  stream_.close();
  if (!stream_) fail(std::strerror(errno));
}

void PartialFile::put_in_place() {
  close();
  std::error_code error;
  std::filesystem::rename(own_, path_, error);
  if (error) fail(error.message());
  own_.clear();
}

void PartialFile::fail(const std::string& reason) const {
  throw InputError(path_, 0, "", "cannot be written: " + reason);
}

bool file_exists(const std::string& path) {
  std::error_code ignored;
  return std::filesystem::exists(path, ignored);
}

std::string read_file(const std::string& path, std::size_t most_bytes) {
  io::InputFile file(path);
  const auto check = [&](std::size_t size) {
    if (size > most_bytes)
      throw InputError(io::shown_name(path), 0, "",
                       "is larger than " + std::to_string(most_bytes >> 20) + " MB");
  };
  check(file.size());
  std::string text(std::max<std::size_t>(file.size() + 1, 4096), '\0');
  std::size_t size = 0;
  while (const std::size_t count = file.read(text.data() + size, text.size() - size)) {
    size += count;
    check(size);
    if (size == text.size()) text.resize(2 * size);
  }
  text.resize(size);
  return text;
}

void write_file(const std::string& path, const std::string& text) {
  if (!is_stream(path)) {
    PartialFile file(path);
    file.write(text);
    return file.put_in_place();
  }
  std::ofstream stream(path, std::ios::binary | std::ios::app);
  if (!stream.write(text.data(), static_cast<std::streamsize>(text.size())).flush())
    throw InputError(path, 0, "", std::string("cannot be written: ") + std::strerror(errno));
}

void require_writable(const std::string& path) {
  if (path.empty() || is_stream(path)) return;
  for (const char* own : measured_files)
    if (std::filesystem::path(path).filename() == own && file_exists(path))
      throw InputError(path, 0, "", "is a table of a recording, and would be lost: name another file");
  const PartialFile probe(path);
  if (std::error_code ignored; std::filesystem::is_directory(path, ignored))
    throw InputError(path, 0, "", "cannot be written: it is a folder");
}

void require_place_for_file(const std::string& path) {
  require_writable(path);
  if (std::error_code none; file_exists(path) && !std::filesystem::is_regular_file(path, none))
    throw InputError(path, 0, "", "cannot be written: it is written to a file only");
}

void require_writable(std::initializer_list<std::string> paths) {
  std::set<std::filesystem::path> seen;
  for (const std::string& path : paths) {
    require_writable(path);
    if (!path.empty() && !is_stream(path) &&
        !seen.insert(std::filesystem::absolute(path).lexically_normal()).second)
      throw InputError(path, 0, "", "is named as the file of two results");
  }
}

void require_apart(const std::vector<std::string>& outputs, const std::vector<std::string>& inputs) {
  std::map<FileIdentity, std::string> read;
  for (const std::string& input : inputs)
    if (const auto identity = identity_of(input)) read.emplace(*identity, input);
  for (const std::string& output : outputs) {
    const auto identity = identity_of(output);
    const auto found = identity ? read.find(*identity) : read.end();
    if (found == read.end() || is_stream(output)) continue;
    throw InputError(io::shown_name(output), 0, "",
                     found->second == output ? std::string("is read, and would be lost: name another file")
                                             : "is the same file as " + io::shown_name(found->second) +
                                                   ", which is read: name another file");
  }
}

void require_distinct(const std::vector<std::string>& inputs) {
  std::map<FileIdentity, std::string> read;
  for (const std::string& input : inputs) {
    const auto identity = identity_of(input);
    if (!identity) continue;
    const auto [first, is_new] = read.emplace(*identity, input);
    if (is_new) continue;
    throw InputError(io::shown_name(input), 0, "",
                     (first->second == input ? std::string("is named twice")
                                             : "is the same file as " + io::shown_name(first->second)) +
                         ": its readings would count twice");
  }
}

void write_files(const std::string& folder, const std::vector<std::pair<std::string, std::string>>& files) {
  std::vector<PartialFile> written;
  written.reserve(files.size());
  for (const auto& [name, text] : files) {
    written.emplace_back((std::filesystem::path(folder) / name).string());
    written.back().write(text);
    written.back().close();
  }
  for (PartialFile& file : written) file.put_in_place();
}

int write_all(int descriptor, std::string_view text) {
  while (!text.empty()) {
    const ssize_t written = ::write(descriptor, text.data(), text.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return errno;
    text.remove_prefix(static_cast<std::size_t>(written));
  }
  return 0;
}

void make_folder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw InputError(path, 0, "", "the folder cannot be made: " + error.message());
  if (!std::filesystem::is_directory(path, error)) throw InputError(path, 0, "", "is not a folder");
}

}  // namespace rangecal
