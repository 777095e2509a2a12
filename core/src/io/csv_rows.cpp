// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/csv_rows.hpp"

#include <csv.h>

#include <limits>
#include <new>
#include <set>

#include "io/csv_fields.hpp"
#include "io/line_feed.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/utf8.hpp"

namespace rangecal {
namespace {

std::string_view trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) return {};
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

}  // namespace

// libcsv takes the rows that hold a quote; the others are split at their separators, which is the same and four
// times as fast.
struct CsvRows::Parser {
  struct QuotedRows : csv_parser {
    explicit QuotedRows(char separator) : csv_parser{} {
      if (csv_init(this, CSV_STRICT | CSV_STRICT_FINI) != 0) throw std::bad_alloc();
      csv_set_delim(this, static_cast<unsigned char>(separator));
    }
    QuotedRows(const QuotedRows&) = delete;
    QuotedRows& operator=(const QuotedRows&) = delete;
    ~QuotedRows() { csv_free(this); }
  };

  std::string name;
  char separator;
  io::LineFeed feed;
  QuotedRows quotes;
  std::vector<std::string> columns;
  std::vector<std::string_view> fields;
  int line = 0, row_line = 1;  ///< the current line; that on which the row began
  bool have_header = false;
  // of a row with quotes
  std::string text;
  std::vector<std::size_t> ends;
  std::size_t bytes = 0;
  bool open = false, ended = false;  ///< a quoted field runs on over the end of its line; the row is whole
  std::size_t too_long = 0;          ///< number of the first field that is

  Parser(io::LineFeed lines, std::string file, char between)
      : name(std::move(file)), separator(between), feed(std::move(lines)), quotes(between) {
    read_header();
  }

  [[noreturn]] void fail(const std::string& what, const std::string& column = "") const {
    throw InputError(name, row_line, column, what);
  }

  // Errors wait until the parser has returned: they must not pass through C.
  static void on_field(void* bytes, std::size_t size, void* self) {
    auto& own = *static_cast<Parser*>(self);
    if (size > io::kLongestField && own.too_long == 0) own.too_long = own.ends.size() + 1;
    if (size <= io::kLongestField) own.text.append(static_cast<const char*>(bytes), size);
    own.ends.push_back(own.text.size());
  }
  static void on_row(int, void* self) { static_cast<Parser*>(self)->ended = true; }

  void fail_too_long(std::size_t field) const {
    fail("field " + std::to_string(field) + " is longer than " + std::to_string(io::kLongestField) +
             " characters",
         field <= columns.size() ? columns[field - 1] : "");
  }

  void split(std::string_view row) {
    for (std::size_t at = 0;;) {
      std::size_t comma = at;
      while (comma < row.size() && row[comma] != separator) ++comma;
      fields.push_back(trimmed(row.substr(at, comma - at)));
      if (fields.back().size() > io::kLongestField) fail_too_long(fields.size());
      if (comma == row.size()) return;
      at = comma + 1;
    }
  }

  void take_quoted() {
    if (too_long > 0) fail_too_long(too_long);
    for (std::size_t i = 0, begin = 0; i < ends.size(); begin = ends[i++])
      fields.push_back(std::string_view(text).substr(begin, ends[i] - begin));
  }

  bool next_line(std::string_view& current) {
    const io::LineFeed::Status status = feed.next(current);
    if (status == io::LineFeed::Status::end) return false;
    if (line == std::numeric_limits<int>::max()) throw InputError(name, 0, "", "holds more than 2^31 lines");
    ++line;
    if (status == io::LineFeed::Status::too_long)
      throw InputError(name, line, "",
                       "is longer than " + std::to_string(io::LineFeed::longest >> 20) + " MB");
    if (first_bad_byte(current) != std::string_view::npos)
      throw InputError(name, line, "", "is not UTF-8 text");
    return true;
  }

  /// The fields of the next row; false at the end.
  bool next_row() {
    fields.clear();
    std::string_view current;
    while (next_line(current)) {
      if (!open) {
        if (current.find_first_not_of(separator == '\t' ? " \r\n" : " \t\r\n") == std::string_view::npos)
          continue;
        row_line = line;
        if (current.find('"') == std::string_view::npos) {
          while (current.back() == '\n' || current.back() == '\r') current.remove_suffix(1);
          split(current);
          return true;
        }
        text.clear(), ends.clear(), bytes = 0, too_long = 0, ended = false;
      }
      bytes += current.size();
      if (bytes > io::LineFeed::longest) fail("the row that begins here is longer than 4 MB");
      const std::size_t parsed = csv_parse(&quotes, current.data(), current.size(), on_field, on_row, this);
      if (parsed != current.size()) {
        if (csv_error(&quotes) == CSV_ENOMEM) throw std::bad_alloc();
        fail("a quote stands where none may");
      }
      open = !ended;
      if (open) continue;
      take_quoted();
      return true;
    }
    if (!open) return false;
    open = false;
    if (csv_fini(&quotes, on_field, on_row, this) != 0) fail("a quote is opened and never closed");
    take_quoted();
    return true;
  }

  void read_header() {
    if (!next_row()) throw InputError(name, 0, "", "is empty: a header row is expected");
    std::set<std::string_view> seen;
    for (std::string_view& field : fields) {
      field = io::label_of(field);
      if (!field.empty() && !seen.insert(field).second) fail("the column is named twice", std::string(field));
    }
    columns.assign(fields.begin(), fields.end());
  }
};

CsvRows::CsvRows(std::unique_ptr<Parser> parser) : parser_(std::move(parser)) {}
CsvRows::CsvRows(CsvRows&&) noexcept = default;
CsvRows::~CsvRows() = default;

CsvRows CsvRows::open(const std::string& path, char separator) {
  return CsvRows(
      std::make_unique<Parser>(io::LineFeed(std::make_unique<io::InputFile>(path)), path, separator));
}

CsvRows CsvRows::parse(std::string_view text, const std::string& name, char separator) {
  return CsvRows(std::make_unique<Parser>(io::LineFeed(text), name, separator));
}

const std::string& CsvRows::file() const { return parser_->name; }
const std::vector<std::string>& CsvRows::columns() const { return parser_->columns; }

std::optional<std::size_t> CsvRows::find(std::string_view column) const {
  return io::find_column(parser_->columns, column);
}

std::optional<std::size_t> CsvRows::optional(std::string_view column) const {
  return io::optional_column(file(), columns(), column);
}

std::size_t CsvRows::require(std::string_view column) const {
  if (const auto found = find(column)) return *found;
  throw InputError(file(), 1, std::string(column), io::missing_column(columns(), column));
}

bool CsvRows::next() {
  if (!parser_->next_row()) return false;
  const std::size_t fields = parser_->fields.size(), columns = parser_->columns.size();
  if (fields != columns)
    parser_->fail("has " + std::to_string(fields) + " fields, the header names " + std::to_string(columns));
  return true;
}

int CsvRows::line() const { return parser_->row_line; }
std::string_view CsvRows::text(std::size_t column) const { return parser_->fields[column]; }

std::string_view CsvRows::label(std::size_t column) const {
  const std::string_view field = text(column);
  if (field.empty()) fail(column, "is empty");
  return io::label_of(field);
}

std::optional<double> CsvRows::number(std::size_t column) const {
  return io::number_of(text(column), [&](const std::string& what) { fail(column, what); });
}

double CsvRows::finite(std::size_t column) const {
  return io::finite_of(text(column), [&](const std::string& what) { fail(column, what); });
}

int CsvRows::count(std::size_t column) const {
  return io::count_of(text(column), [&](const std::string& what) { fail(column, what); });
}

void CsvRows::fail(std::size_t column, const std::string& what) const {
  parser_->fail(what, parser_->columns[column]);
}

}  // namespace rangecal
