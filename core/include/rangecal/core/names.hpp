// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "rangecal/core/errors.hpp"

namespace rangecal {

/// One row of a table of names.
template <typename Value>
struct Name {
  Value value;
  const char* text;
};

/// The texts that the values of an enum have in files and on the command line. Of a value with several rows the first text
/// is the one written; the others are read as well. Made by `names_of`.
template <typename Value, std::size_t N>
struct Names {
  const char* what;  ///< is named, as messages say it: "noise law"
  std::array<Name<Value>, N> rows;

  /// Its text; "" for a value without a row.
  constexpr const char* name_of(Value value) const {
    for (const Name<Value>& row : rows)
      if (row.value == value) return row.text;
    return "";
  }

  /// The value of exactly this text.
  constexpr std::optional<Value> find(std::string_view text) const {
    for (const Name<Value>& row : rows)
      if (text == row.text) return row.value;
    return std::nullopt;
  }

  /// The texts written, in the order of the rows: "a, b, c".
  std::string list() const {
    std::string texts;
    for (const Name<Value>& row : rows)
      if (std::string_view(row.text) == name_of(row.value))
        texts += (texts.empty() ? "" : ", ") + std::string(row.text);
    return texts;
  }

  /// As `find`; throws InputError naming the accepted texts where no row has this one.
  Value value_of(const std::string& text) const {
    if (const std::optional<Value> value = find(text)) return *value;
    throw InputError(std::string(what) + " is '" + text + "', not one of " + list());
  }

  /// The values in the order of the rows; of a table in which each has one row.
  constexpr std::array<Value, N> values() const {
    std::array<Value, N> all{};
    for (std::size_t i = 0; i < N; ++i) all[i] = rows[i].value;
    return all;
  }
};

/// names_of<NoiseLaw>("noise law", {{NoiseLaw::constant, "constant"}, ...})
template <typename Value, std::size_t N>
constexpr Names<Value, N> names_of(const char* what, const Name<Value> (&rows)[N]) {
  Names<Value, N> names{what, {}};
  for (std::size_t i = 0; i < N; ++i) names.rows[i] = rows[i];
  return names;
}

}  // namespace rangecal
