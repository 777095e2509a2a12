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

/// The label that csv_label wrote as this field.
std::string_view label_of(std::string_view field);

/// Where the column stands; the first of that name.
std::optional<std::size_t> find_column(const std::vector<std::string>& columns, std::string_view name);

}  // namespace rangecal::io
