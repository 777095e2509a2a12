// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rangecal/core/scan.hpp"

namespace rangecal::io {

/// The lines of a text with their numbers, from 1; CR before LF is removed.
class Lines {
 public:
  Lines(std::string_view text, const std::string& file) : rest_(text), file_(file) {}
  /// False at the end. `line` stays valid as long as the text. Throws InputError for a line of more than 16 MB.
  bool next(std::string_view& line);
  int number() const { return number_; }
  /// True if nothing but blanks follows the line that next() gave.
  bool was_last() const { return rest_.find_first_not_of(" \t\r\n") == std::string_view::npos; }
  /// True if that line had its end: a file that was cut off while it was written has none.
  bool had_end() const { return had_end_; }

 private:
  bool had_end_ = true;
  std::string_view rest_;
  const std::string& file_;
  int number_ = 0;
};

/// The fields of a line: split at commas, spaces trimmed; or at runs of spaces and tabs.
std::vector<std::string_view> comma_fields(std::string_view line);
std::vector<std::string_view> word_fields(std::string_view line);

/// A field as a number; nan, inf and nothing (NaN) are accepted where `beam`. Throws InputError naming the place.
double number_in(std::string_view field, bool beam, const std::string& file, int row,
                 const std::string& column);

/// What ScanLog::warning says of a last line that is left out.
std::string last_line_left_out(const std::string& path, int row, const std::string& why);
constexpr const char* torn_line = "is torn, as where a recording was cut off";

ScanLog read_csv_scans(const std::string& path, const std::string& text);
ScanLog read_carmen_log(const std::string& path, const std::string& text);

}  // namespace rangecal::io
