// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rangecal/core/descriptor.hpp"

namespace rangecal::app {

/// Lines of a file that may still grow, or of stdin, in a buffer that holds what is not yet a whole line.
class LineSource {
 public:
  /// "-" is stdin. Throws InputError for a file that cannot be read.
  explicit LineSource(const std::string& path);
  LineSource(const LineSource&) = delete;
  LineSource& operator=(const LineSource&) = delete;

  enum class Status { line, end, interrupted };
  /// The next whole line without its end. `end`: there is none now; a file may have one later. `interrupted`: a signal
  /// came while stdin was waited for.
  Status next(std::string& line);
  /// What stands after the last line end, taken as a line.
  std::string rest();
  std::int64_t offset() const { return offset_; }  ///< bytes taken as lines
  std::string fingerprint() const;                 ///< of these bytes
  bool has_rest() const { return begin_ < buffer_.size(); }
  /// A file, which begins anew for each run; false: stdin or a pipe, which goes on.
  bool begins_anew() const { return file_is_regular_; }
  /// Why nothing can follow in a file that is waited on: cut back, or replaced by another; empty while it can.
  std::string lost() const;

 private:
  std::string path_, buffer_;
  std::size_t begin_ = 0;
  std::int64_t offset_ = 0;
  std::uint64_t taken_ = 0;
  Descriptor opened_;  ///< none: stdin
  int file_ = -1;
  bool file_is_regular_ = false;
};

/// The fields of one line of CSV; quotes around a field are removed, doubled ones inside are one. Nothing where a quote is
/// left open.
std::optional<std::vector<std::string>> csv_fields(std::string_view line);

/// A number that fills the text, spaces around it aside; nothing otherwise.
std::optional<double> number_of(std::string_view text);

}  // namespace rangecal::app
