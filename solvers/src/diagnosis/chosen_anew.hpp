// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/rates.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// What the search chose among the starts of a grid (a period, a stop, a landmark, a time constant) is chosen
/// anew from `part` alone, one effect after the other, the rest held: the highest scores over the effect's
/// grid are refitted, and the best of them is kept where it beats `fitted`, the model fitted to the part with
/// the choices of all readings.
Fit chosen_anew(const Rows& part, Fit fitted, const Rates& rates, const RefitOptions& options);

}  // namespace rangecal::diagnosis
