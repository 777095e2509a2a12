// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/outcome.hpp"

#include <array>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

constexpr std::array<std::pair<Outcome, const char*>, 6> kOutcomeNames{
    {{Outcome::converged, "converged"},
     {Outcome::not_converged, "not_converged"},
     {Outcome::unbounded, "unbounded"},
     {Outcome::unobservable, "unobservable"},
     {Outcome::too_few_data, "too_few_data"},
     {Outcome::failed, "failed"}}};

}  // namespace

const char* to_string(Outcome outcome) {
  for (const auto& [value, name] : kOutcomeNames) {
    if (value == outcome) return name;
  }
  return "failed";
}

Outcome outcome_from_string(const std::string& text) {
  std::string accepted;
  for (const auto& [value, name] : kOutcomeNames) {
    if (text == name) return value;
    accepted += (accepted.empty() ? "" : ", ") + std::string(name);
  }
  throw InputError("outcome is '" + text + "', not one of " + accepted);
}

}  // namespace rangecal
