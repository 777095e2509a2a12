// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <cmath>
#include <string>

namespace rangecal::app {

/// A check of an option: a finite number that `holds`, else "Value -1 is not a positive number". CLI11's own
/// say so by printing the largest double in full, 309 digits.
inline CLI::Validator number_that(bool (*holds)(double), const std::string& is) {
  return CLI::Validator(
      [holds, is](const std::string& text) {
        double value = 0.0;
        const bool read = CLI::detail::lexical_cast(text, value);
        return read && std::isfinite(value) && holds(value) ? std::string()
                                                            : "Value " + text + " is not " + is;
      },
      std::string());
}

inline CLI::Validator positive() {
  return number_that([](double value) { return value > 0.0; }, "a positive number");
}

inline CLI::Validator not_negative() {
  return number_that([](double value) { return value >= 0.0; }, "a number from 0 up");
}

/// Of a seed: a conversion alone takes -1 for 18446744073709551615.
inline CLI::Validator whole() {
  return CLI::Validator(
      [](const std::string& text) {
        const bool digits = text.find_first_not_of("0123456789") == std::string::npos;
        return digits ? std::string() : "Value " + text + " is not a whole number from 0 up";
      },
      std::string());
}

}  // namespace rangecal::app
