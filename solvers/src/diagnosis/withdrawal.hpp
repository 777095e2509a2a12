// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "diagnosis/held_out.hpp"

namespace rangecal::diagnosis {

/// True if held-out readings speak against a model: they are predicted worse than by the seed model, by more than twice
/// the standard error of that.
bool speaks_against(const HeldOutChange& change);

/// Takes names back that held-out readings speak against.
///
/// The answer's own (beside a smooth curve: where they predict worse without it, too): `found` is then one that no name
/// explains, to be reported anew, and the sentence that says so is returned; else an empty one. Other explanations: they
/// are left out of `found` and `result`, and a note says so. What bookkeeping alone found stays: it is read off the
/// values. `result`: with its held-out densities.
std::string withdraw_names(const Rows& rows, SearchResult& found, Diagnosis& result);

}  // namespace rangecal::diagnosis
