// SPDX-License-Identifier: BSD-3-Clause
#include "io/csv_fields.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <limits>
#include <system_error>

#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/csv_table.hpp"

namespace rangecal {
namespace io {
namespace {

std::string quoted(std::string_view text) {
  constexpr std::size_t longest = 40;
  return text.size() <= longest ? fmt::format("'{}'", text) : fmt::format("'{}...'", text.substr(0, longest));
}

/// True for a text that a spreadsheet would run, apostrophes in front of it aside.
bool is_formula(std::string_view text) {
  text.remove_prefix(std::min(text.find_first_not_of('\''), text.size()));
  if (text.empty()) return false;
  double value = 0.0;
  const bool sign = text.front() == '+' || text.front() == '-';
  return text.front() == '=' || text.front() == '@' || (sign && parse_number(text, value) != Parsed::number);
}

}  // namespace

Parsed parse_number(std::string_view field, double& value) {
  if (field.empty() || field == "NA") return Parsed::empty;
  if (field.front() == '+' && field.size() > 1 && field[1] != '-' && field[1] != '+') field.remove_prefix(1);
  const auto [end, code] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (end != field.data() + field.size() || code == std::errc::invalid_argument) return Parsed::malformed;
  return code == std::errc::result_out_of_range ? Parsed::too_large : Parsed::number;
}

std::string number_fault(std::string_view field, Parsed parsed) {
  if (parsed == Parsed::too_large) return quoted(field) + " is beyond what a number can hold";
  return parsed == Parsed::malformed ? quoted(field) + " is not a number" : "";
}

std::string finite_fault(std::string_view field, Parsed parsed, double value) {
  if (parsed == Parsed::empty) return "is empty";
  if (parsed != Parsed::number) return number_fault(field, parsed);
  return std::isfinite(value) ? "" : quoted(field) + " is not finite";
}

std::string count_fault(std::string_view field, double value) {
  const bool whole = value >= 0.0 && value <= std::numeric_limits<int>::max() && value == std::floor(value);
  return whole ? "" : quoted(field) + " is not a whole number of at least 0";
}

std::string_view label_of(std::string_view field) {
  return field.starts_with('\'') && is_formula(field) ? field.substr(1) : field;
}

std::optional<std::size_t> find_column(const std::vector<std::string>& columns, std::string_view name) {
  const auto found = std::find(columns.begin(), columns.end(), name);
  if (found == columns.end()) return std::nullopt;
  return static_cast<std::size_t>(found - columns.begin());
}

namespace {

/// A name in small letters without its unit: "Radius_mm" and "radius_m" are both "radius".
std::string stem_of(std::string_view name) {
  std::string stem(name);
  for (char& c : stem) c = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  for (const std::string_view unit : {"_m", "_mm", "_cm", "_km", "_in", "_ft", "_rad", "_deg", "_degrees",
                                      "_mrad", "_s", "_ms", "_us", "_ns", "_min", "_h"})
    if (stem.size() > unit.size() && stem.ends_with(unit)) return stem.substr(0, stem.size() - unit.size());
  return stem;
}

}  // namespace

std::optional<std::string> lookalike(const std::vector<std::string>& columns, std::string_view name) {
  const std::string stem = stem_of(name);
  const auto close = std::find_if(columns.begin(), columns.end(), [&](const std::string& column) {
    return column != name && stem_of(column) == stem;
  });
  if (close == columns.end()) return std::nullopt;
  return *close;
}

std::optional<std::size_t> optional_column(const std::string& file, const std::vector<std::string>& columns,
                                           std::string_view name) {
  const auto found = find_column(columns, name);
  if (found) return found;
  if (const auto close = lookalike(columns, name))
    throw InputError(file, 1, *close, "is not read; '" + std::string(name) + "' is");
  return std::nullopt;
}

std::string missing_column(const std::vector<std::string>& columns, std::string_view name) {
  const std::string text = "the column is missing";
  constexpr std::size_t shown = 40;
  if (columns.size() == 1 && columns[0].find_first_of(";\t") != std::string::npos)
    return text + ": the row is one field, '" + columns[0].substr(0, shown) +
           "'; columns are separated by commas";
  const std::optional<std::string> close = lookalike(columns, name);
  return close ? text + "; there is '" + *close + "'" : text;
}

}  // namespace io

std::string csv_field(const std::string& text, char separator) {
  const bool spaced = !text.empty() && (text.front() == ' ' || text.front() == '\t' || text.back() == ' ' ||
                                        text.back() == '\t');
  if (!spaced && text.find_first_of(std::string("\"\r\n") + separator) == std::string::npos) return text;
  std::string field = "\"";
  for (const char c : text) {
    if (c == '"') field += '"';
    field += c;
  }
  return field + "\"";
}

std::string csv_label(const std::string& text) { return csv_field(io::is_formula(text) ? "'" + text : text); }

}  // namespace rangecal
