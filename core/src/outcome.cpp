// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/outcome.hpp"

#include "rangecal/core/names.hpp"

namespace rangecal {
namespace {

constexpr auto outcome_names = names_of<Outcome>("outcome", {{Outcome::converged, "converged"},
                                                             {Outcome::not_converged, "not_converged"},
                                                             {Outcome::unbounded, "unbounded"},
                                                             {Outcome::unobservable, "unobservable"},
                                                             {Outcome::too_few_data, "too_few_data"},
                                                             {Outcome::failed, "failed"}});

}  // namespace

const char* to_string(Outcome outcome) { return outcome_names.name_of(outcome); }

Outcome outcome_from_string(const std::string& text) { return outcome_names.value_of(text); }

}  // namespace rangecal
