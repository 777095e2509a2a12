// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/csv_table.hpp"

#include <csv.h>

#include <charconv>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <system_error>

#include <fmt/format.h>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal {
namespace {

constexpr std::size_t kLongestField = 4096;

// The first character of `line` that no UTF-8 text holds, or npos: NUL bytes and malformed sequences.
std::size_t first_bad_byte(std::string_view line) {
  for (std::size_t i = 0; i < line.size();) {
    const auto byte = static_cast<unsigned char>(line[i]);
    const std::size_t length = byte < 0x80 ? 1 : byte < 0xc2 ? 0 : byte < 0xe0 ? 2 : byte < 0xf0 ? 3 : byte < 0xf5 ? 4 : 0;
    if (byte == 0 || length == 0 || i + length > line.size()) return i;
    for (std::size_t k = 1; k < length; ++k) {
      if ((static_cast<unsigned char>(line[i + k]) & 0xc0) != 0x80) return i;
    }
    i += length;
  }
  return std::string_view::npos;
}

std::string quoted(std::string_view text) {
  constexpr std::size_t longest = 40;
  return text.size() <= longest ? fmt::format("'{}'", text) : fmt::format("'{}...'", text.substr(0, longest));
}

struct ParserDeleter {
  void operator()(csv_parser* parser) const {
    csv_free(parser);
    delete parser;
  }
};

}  // namespace

/// Collects what libcsv reports. Errors are kept until the parser has returned: they must not pass through C.
struct CsvBuilder {
  CsvTable table;
  int row_line = 1;                  ///< line on which the current row began
  bool row_ended = false;
  std::vector<std::string> header;
  bool have_header = false;
  std::size_t fields_in_row = 0;
  std::string error;
  std::string error_column;

  void field(const char* text, std::size_t size) {
    if (!error.empty()) return;
    if (size > kLongestField) {
      if (have_header && fields_in_row < header.size()) error_column = header[fields_in_row];
      error = "field " + std::to_string(fields_in_row + 1) + " is longer than " + std::to_string(kLongestField) +
              " characters";
      return;
    }
    if (have_header) {
      table.fields_.append(text, size);
      table.ends_.push_back(table.fields_.size());
    } else {
      header.emplace_back(text, size);
    }
    ++fields_in_row;
  }

  void row() {
    row_ended = true;
    if (!error.empty()) return;
    if (!have_header) {
      have_header = true;
      std::set<std::string> seen;
      for (const std::string& name : header) {
        if (!name.empty() && !seen.insert(name).second) {
          error_column = name;
          error = "the column is named twice";
          return;
        }
      }
    } else if (fields_in_row != header.size()) {
      error = "has " + std::to_string(fields_in_row) + " fields, the header names " + std::to_string(header.size());
    } else {
      table.lines_.push_back(row_line);
    }
    fields_in_row = 0;
  }

  void stop_on_error() const {
    if (!error.empty()) throw InputError(table.file_, row_line, error_column, error);
  }
};

namespace {

void on_field(void* text, std::size_t size, void* builder) {
  static_cast<CsvBuilder*>(builder)->field(static_cast<const char*>(text), size);
}
void on_row(int, void* builder) { static_cast<CsvBuilder*>(builder)->row(); }

}  // namespace

CsvTable CsvTable::read(const std::string& path) { return parse(read_file(path), path); }

CsvTable CsvTable::parse(const std::string& text, const std::string& name) {
  CsvBuilder builder;
  builder.table.file_ = name;

  auto parser = std::unique_ptr<csv_parser, ParserDeleter>(new csv_parser);
  if (csv_init(parser.get(), CSV_STRICT | CSV_STRICT_FINI) != 0) throw std::bad_alloc();

  std::string_view rest = text;
  if (rest.starts_with("\xef\xbb\xbf")) rest.remove_prefix(3);
  int line = 1;
  bool row_open = false;   // a quoted field runs on over the end of its line
  while (!rest.empty()) {
    // One line at a time, so that the line on which a row begins is known.
    std::size_t size = rest.find_first_of("\r\n");
    if (size == std::string_view::npos) {
      size = rest.size();
    } else {
      size += rest.substr(size).starts_with("\r\n") ? 2 : 1;
    }
    const std::string_view current = rest.substr(0, size);
    rest.remove_prefix(size);
    if (first_bad_byte(current) != std::string_view::npos) {
      throw InputError(name, line, "", "is not UTF-8 text");
    }
    if (!row_open) builder.row_line = line;
    builder.row_ended = false;
    const std::size_t parsed = csv_parse(parser.get(), current.data(), size, on_field, on_row, &builder);
    builder.stop_on_error();
    if (parsed != size) throw InputError(name, builder.row_line, "", "a quote stands where none may");
    const bool blank = current.find_first_not_of(" \t\r\n") == std::string_view::npos;
    row_open = !builder.row_ended && (row_open || !blank);
    ++line;
  }
  if (csv_fini(parser.get(), on_field, on_row, &builder) != 0) {
    builder.stop_on_error();
    throw InputError(name, builder.row_line, "", "a quote is opened and never closed");
  }
  builder.stop_on_error();
  if (!builder.have_header) throw InputError(name, 0, "", "is empty: a header row is expected");
  builder.table.columns_ = std::move(builder.header);
  return std::move(builder.table);
}

std::optional<std::size_t> CsvTable::find(std::string_view column) const {
  for (std::size_t i = 0; i < columns_.size(); ++i) {
    if (columns_[i] == column) return i;
  }
  return std::nullopt;
}

std::size_t CsvTable::require(std::string_view column) const {
  if (const auto found = find(column)) return *found;
  throw InputError(file_, 1, std::string(column), "the column is missing");
}

std::string_view CsvTable::text(std::size_t row, std::size_t column) const {
  const std::size_t i = row * columns_.size() + column;
  const std::size_t begin = i == 0 ? 0 : ends_[i - 1];
  return std::string_view(fields_).substr(begin, ends_[i] - begin);
}

std::string CsvTable::label(std::size_t row, std::size_t column) const {
  const std::string_view field = text(row, column);
  if (field.empty()) fail(row, column, "is empty");
  return std::string(field);
}

namespace {

enum class Parsed { number, empty, malformed, too_large };

Parsed parse_number(std::string_view field, double& value) {
  if (field.empty() || field == "NA") return Parsed::empty;
  if (field.front() == '+' && field.size() > 1 && field[1] != '-' && field[1] != '+') field.remove_prefix(1);
  const auto [end, code] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (end != field.data() + field.size() || code == std::errc::invalid_argument) return Parsed::malformed;
  return code == std::errc::result_out_of_range ? Parsed::too_large : Parsed::number;
}

}  // namespace

std::optional<double> CsvTable::number(std::size_t row, std::size_t column) const {
  double value = 0.0;
  switch (parse_number(text(row, column), value)) {
    case Parsed::number: return value;
    case Parsed::empty: return std::nullopt;
    case Parsed::too_large: fail(row, column, quoted(text(row, column)) + " is beyond what a number can hold");
    case Parsed::malformed: break;
  }
  fail(row, column, quoted(text(row, column)) + " is not a number");
}

double CsvTable::finite(std::size_t row, std::size_t column) const {
  const auto value = number(row, column);
  if (!value) fail(row, column, "is empty");
  if (!std::isfinite(*value)) fail(row, column, quoted(text(row, column)) + " is not finite");
  return *value;
}

int CsvTable::count(std::size_t row, std::size_t column) const {
  const double value = finite(row, column);
  if (value < 0.0 || value > std::numeric_limits<int>::max() || value != std::floor(value)) {
    fail(row, column, quoted(text(row, column)) + " is not a whole number of at least 0");
  }
  return static_cast<int>(value);
}

bool CsvTable::is_numeric(std::size_t column) const {
  bool any = false;
  for (std::size_t row = 0; row < rows(); ++row) {
    double value = 0.0;
    const Parsed parsed = parse_number(text(row, column), value);
    if (parsed == Parsed::malformed || parsed == Parsed::too_large) return false;
    any = any || parsed == Parsed::number;
  }
  return any;
}

void CsvTable::fail(std::size_t row, std::size_t column, const std::string& what) const {
  throw InputError(file_, lines_[row], columns_[column], what);
}

std::string csv_field(const std::string& text) {
  const bool spaced = !text.empty() && (text.front() == ' ' || text.front() == '\t' || text.back() == ' ' ||
                                        text.back() == '\t');
  if (!spaced && text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string field = "\"";
  for (const char c : text) {
    if (c == '"') field += '"';
    field += c;
  }
  return field + "\"";
}

}  // namespace rangecal
