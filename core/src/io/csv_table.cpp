// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/csv_table.hpp"

#include "io/csv_fields.hpp"
#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {

struct CsvBuilder {
  static CsvTable table(CsvRows rows) {
    CsvTable table;
    table.file_ = rows.file();
    table.columns_ = rows.columns();
    while (rows.next()) {
      for (std::size_t column = 0; column < table.columns_.size(); ++column) {
        table.fields_ += rows.text(column);
        table.ends_.push_back(table.fields_.size());
      }
      table.lines_.push_back(rows.line());
    }
    return table;
  }
};

CsvTable CsvTable::read(const std::string& path) { return CsvBuilder::table(CsvRows::open(path)); }

CsvTable CsvTable::parse(const std::string& text, const std::string& name) {
  return CsvBuilder::table(CsvRows::parse(text, name));
}

std::optional<std::size_t> CsvTable::find(std::string_view column) const {
  return io::find_column(columns_, column);
}

std::size_t CsvTable::require(std::string_view column) const {
  if (const auto found = find(column)) return *found;
  throw InputError(file_, 1, std::string(column), io::missing_column(columns_, column));
}

std::optional<std::size_t> CsvTable::optional(std::string_view column) const {
  return io::optional_column(file_, columns_, column);
}

std::string_view CsvTable::text(std::size_t row, std::size_t column) const {
  const std::size_t i = row * columns_.size() + column;
  const std::size_t begin = i == 0 ? 0 : ends_[i - 1];
  return std::string_view(fields_).substr(begin, ends_[i] - begin);
}

std::string CsvTable::label(std::size_t row, std::size_t column) const {
  const std::string_view field = text(row, column);
  if (field.empty()) fail(row, column, "is empty");
  return std::string(io::label_of(field));
}

std::optional<double> CsvTable::number(std::size_t row, std::size_t column) const {
  return io::number_of(text(row, column), [&](const std::string& what) { fail(row, column, what); });
}

double CsvTable::finite(std::size_t row, std::size_t column) const {
  return io::finite_of(text(row, column), [&](const std::string& what) { fail(row, column, what); });
}

int CsvTable::count(std::size_t row, std::size_t column) const {
  return io::count_of(text(row, column), [&](const std::string& what) { fail(row, column, what); });
}

bool CsvTable::is_numeric(std::size_t column) const {
  bool any = false;
  for (std::size_t row = 0; row < rows(); ++row) {
    double value = 0.0;
    const io::Parsed parsed = io::parse_number(text(row, column), value);
    if (parsed == io::Parsed::malformed || parsed == io::Parsed::too_large) return false;
    any = any || parsed == io::Parsed::number;
  }
  return any;
}

void CsvTable::fail(std::size_t row, std::size_t column, const std::string& what) const {
  throw InputError(file_, lines_[row], columns_[column], what);
}

}  // namespace rangecal
