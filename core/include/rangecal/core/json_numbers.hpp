// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <exception>
#include <limits>
#include <string>

#include "rangecal/core/errors.hpp"

namespace rangecal {

/// A value of a JSON file as a whole number from `low` to `high`; throws InputError naming the field for
/// anything else. The parser's own conversion takes 1.5 for 1, and what an int cannot hold for anything.
/// `Json` is one of nlohmann's.
template <typename Whole = int, typename Json>
Whole whole_number(const Json& json, const std::string& field, Whole low = 0,
                   Whole high = std::numeric_limits<Whole>::max()) {
  const bool there = json.is_number_unsigned()
                         ? json.template get<std::uint64_t>() <= static_cast<std::uint64_t>(INT64_MAX)
                         : json.is_number_integer();
  const std::int64_t value = there ? json.template get<std::int64_t>() : 0;
  if (!there || value < static_cast<std::int64_t>(low) || value > static_cast<std::int64_t>(high))
    throw InputError("field '" + field + "' is not a whole number from " + std::to_string(low) + " to " +
                     std::to_string(high));
  return static_cast<Whole>(value);
}

/// What the parser says of a file, without its own "[json.exception.parse_error.101] " before it.
inline std::string json_complaint(const std::exception& error) {
  const std::string text = error.what();
  const std::size_t end = text.rfind("[json.exception.", 0) == 0 ? text.find("] ") : std::string::npos;
  return end == std::string::npos ? text : text.substr(end + 2);
}

}  // namespace rangecal
