// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rangecal {

/// The rows of a CSV file one after the other, in memory that does not grow with their number: a header row
/// and rows of as many fields (RFC 4180 quoting, LF or CRLF, UTF-8 with or without a byte order mark, blank
/// lines skipped, spaces around unquoted fields removed). Columns are found by name. Everything malformed
/// throws InputError with file, row (the line in the file, header = 1) and column. Cost: linear in the size
/// of the file, some 2 ns a byte.
class CsvRows {
 public:
  /// Opens `path` and reads the header. Throws for a missing, empty or binary file and for a column named
  /// twice.
  static CsvRows open(const std::string& path, char separator = ',');
  /// The same from text, which must outlive the rows; `name` stands for the file in messages.
  static CsvRows parse(std::string_view text, const std::string& name, char separator = ',');
  CsvRows(CsvRows&&) noexcept;
  ~CsvRows();

  const std::string& file() const;
  const std::vector<std::string>& columns() const;
  std::optional<std::size_t> find(std::string_view column) const;
  std::size_t require(std::string_view column) const;  ///< throws if there is no such column
  /// A column that may be left out; throws where another one has its name but for capitals or the unit.
  std::optional<std::size_t> optional(std::string_view column) const;

  bool next();       ///< goes to the next row; false at the end
  int line() const;  ///< of the row in the file

  std::string_view text(std::size_t column) const;   ///< valid until the next row
  std::string_view label(std::size_t column) const;  ///< see CsvTable
  std::optional<double> number(std::size_t column) const;
  double finite(std::size_t column) const;
  int count(std::size_t column) const;
  [[noreturn]] void fail(std::size_t column, const std::string& what) const;

 private:
  struct Parser;
  explicit CsvRows(std::unique_ptr<Parser> parser);
  std::unique_ptr<Parser> parser_;
};

/// A label or a column's name as a CSV field. One that a spreadsheet would take for a formula (it begins with
/// =, @, or with + or - and is no number) gets an apostrophe in front, which the readers take off again.
std::string csv_label(const std::string& text);

}  // namespace rangecal
