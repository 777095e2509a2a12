// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rangecal::app {

/// Lines of a file that may still grow, or of stdin, in a buffer that holds what is not yet a whole line.
class LineSource {
 public:
  /// "-" is stdin. `offset`: bytes of the file that were taken before. Throws InputError for a file that cannot be read
  /// or is shorter than that.
  LineSource(const std::string& path, std::int64_t offset);
  LineSource(const LineSource&) = delete;
  LineSource& operator=(const LineSource&) = delete;
  ~LineSource();

  enum class Status { line, end, interrupted };
  /// The next whole line without its end. `end`: there is none now; a file may have one later. `interrupted`: a signal
  /// came while stdin was waited for.
  Status next(std::string& line);
  /// What stands after the last line end, taken as a line.
  std::string rest();
  std::int64_t offset() const { return offset_; }  ///< bytes taken as lines
  bool has_rest() const { return begin_ < buffer_.size(); }

 private:
  std::string path_, buffer_;
  std::size_t begin_ = 0;
  std::int64_t offset_ = 0;
  int file_ = -1;
};

/// The fields of one line of CSV; quotes around a field are removed, doubled ones inside are one. Nothing where a quote is
/// left open.
std::optional<std::vector<std::string>> csv_fields(std::string_view line);

/// A number that fills the text, spaces around it aside; nothing otherwise.
std::optional<double> number_of(std::string_view text);

}  // namespace rangecal::app
