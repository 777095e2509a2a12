// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "io/input_file.hpp"

namespace rangecal::io {

/// The lines of a text in memory, or of a file in a buffer that holds one line at least; a byte order mark is
/// skipped.
class LineFeed {
 public:
  static constexpr std::size_t longest = std::size_t{4} << 20;

  explicit LineFeed(std::string_view text);
  explicit LineFeed(std::unique_ptr<InputFile> file);

  enum class Status { line, end, too_long };
  /// The next line with its end (LF, CRLF or CR), valid until the next call.
  Status next(std::string_view& line);

 private:
  static constexpr std::size_t room = longest + (std::size_t{1} << 20);  ///< of the buffer

  void fill();
  void skip_mark();

  std::unique_ptr<InputFile> file_;
  std::unique_ptr<char[]> buffer_;  ///< of a file
  const char* data_ = nullptr;
  std::size_t begin_ = 0, end_ = 0;
  bool whole_ = false;  ///< nothing follows what is in the buffer
};

}  // namespace rangecal::io
