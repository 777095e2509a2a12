// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace rangecal::io {

constexpr std::size_t kLongestField = 4096;

enum class Parsed { number, empty, malformed, too_large };
/// A field as a number: empty is nothing or `NA`; nan and inf are numbers.
Parsed parse_number(std::string_view field, double& value);

/// What keeps a field from being a number, a finite one, a whole one of at least 0; empty if nothing does.
std::string number_fault(std::string_view field, Parsed parsed);
std::string finite_fault(std::string_view field, Parsed parsed, double value);
std::string count_fault(std::string_view field, double value);

/// A field as a number, nothing where it is empty; as a finite one; as a whole one of at least 0. `fail(what)`
/// throws with the field's place.
template <typename Fail>
std::optional<double> number_of(std::string_view field, const Fail& fail) {
  double value = 0.0;
  const Parsed parsed = parse_number(field, value);
  if (const std::string fault = number_fault(field, parsed); !fault.empty()) fail(fault);
  return parsed == Parsed::number ? std::optional<double>(value) : std::nullopt;
}
template <typename Fail>
double finite_of(std::string_view field, const Fail& fail) {
  double value = 0.0;
  const Parsed parsed = parse_number(field, value);
  if (const std::string fault = finite_fault(field, parsed, value); !fault.empty()) fail(fault);
  return value;
}
template <typename Fail>
int count_of(std::string_view field, const Fail& fail) {
  const double value = finite_of(field, fail);
  if (const std::string fault = count_fault(field, value); !fault.empty()) fail(fault);
  return static_cast<int>(value);
}

/// The label that csv_label wrote as this field.
std::string_view label_of(std::string_view field);

/// Where the column stands; the first of that name.
std::optional<std::size_t> find_column(const std::vector<std::string>& columns, std::string_view name);

/// A column that may be meant by this name: the same but for capitals or the unit.
std::optional<std::string> lookalike(const std::vector<std::string>& columns, std::string_view name);

/// A column that may be left out. Throws where another one of `file` has its name but for capitals or the unit.
std::optional<std::size_t> optional_column(const std::string& file, const std::vector<std::string>& columns,
                                           std::string_view name);

/// What to say where there is no such column: the header may be cut by another separator, or spell it
/// otherwise.
std::string missing_column(const std::vector<std::string>& columns, std::string_view name);

}  // namespace rangecal::io
