// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rangecal {

/// A CSV file in memory: a header row and rows of as many fields (RFC 4180 quoting, LF or CRLF, UTF-8 with or
/// without a byte order mark, blank lines skipped, spaces around unquoted fields removed). Columns are found by
/// name. Everything malformed throws InputError with file, row (the line in the file, header = 1) and column.
class CsvTable {
 public:
  /// Reads `path`. Throws for a missing, empty, binary or ragged file and for a column named twice.
  static CsvTable read(const std::string& path);
  /// The same from text; `name` stands for the file in messages.
  static CsvTable parse(const std::string& text, const std::string& name);

  const std::string& file() const { return file_; }
  const std::vector<std::string>& columns() const { return columns_; }
  std::size_t rows() const { return lines_.size(); }
  int line(std::size_t row) const { return lines_[row]; }  ///< line in the file of row 0, 1, ...

  std::optional<std::size_t> find(std::string_view column) const;
  std::size_t require(std::string_view column) const;  ///< throws if there is no such column
  /// A column that may be left out; throws where another one has its name but for capitals or the unit
  /// (radius_mm for radius_m), which would be left out unsaid.
  std::optional<std::size_t> optional(std::string_view column) const;

  std::string_view text(std::size_t row, std::size_t column) const;
  /// The field as a text that must not be empty.
  std::string label(std::size_t row, std::size_t column) const;
  /// The field as a number: nothing if empty or `NA`; nan and inf are numbers here. Throws for anything else.
  std::optional<double> number(std::size_t row, std::size_t column) const;
  /// The field as a finite number; throws where it is empty or not finite.
  double finite(std::size_t row, std::size_t column) const;
  /// The field as a whole number of at least 0.
  int count(std::size_t row, std::size_t column) const;
  /// True if some field of the column is a number and all the others are numbers or empty.
  bool is_numeric(std::size_t column) const;

  [[noreturn]] void fail(std::size_t row, std::size_t column, const std::string& what) const;

 private:
  friend struct CsvBuilder;
  std::string file_;
  std::vector<std::string> columns_;
  std::string fields_;             ///< all fields end to end, row by row
  std::vector<std::size_t> ends_;  ///< end of each field in fields_
  std::vector<int> lines_;
};

/// A text as a field of a table with that separator: quoted where it has to be.
std::string csv_field(const std::string& text, char separator = ',');

}  // namespace rangecal
