// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration.hpp"

#include <array>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

constexpr std::array<std::pair<Method, const char*>, 4> kNames{{{Method::closed_form, "closed-form"},
                                                                {Method::approximate, "approximate"},
                                                                {Method::full, "full"},
                                                                {Method::marginal, "marginal"}}};

}  // namespace

const char* to_string(Method method) {
  for (const auto& [value, name] : kNames) {
    if (value == method) return name;
  }
  return "marginal";
}

Method method_from_string(const std::string& text) {
  std::string accepted;
  for (const auto& [value, name] : kNames) {
    if (text == name) return value;
    accepted += (accepted.empty() ? "" : ", ") + std::string(name);
  }
  throw InputError("method is '" + text + "', not one of " + accepted);
}

}  // namespace rangecal
