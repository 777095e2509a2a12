// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "diagnosis/generic_effect.hpp"
#include "diagnosis/rates.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// Keeps curves alive that a fit's model points to.
using OwnedCurves = std::vector<std::shared_ptr<GenericEffect>>;

/// Selects again, from the training part alone, what the search selected on all readings, so that held-out readings know
/// nothing of it: starts of grids (a period, a stop, a landmark, a time constant), one effect after the other, the rest held.
/// The highest scores over the effect's grid are refitted, and the best is kept where it beats `fitted`, the model fitted to
/// the part with the selection of all readings. Curves without a name get knots and smoothness from `part`, and are left out
/// where it shows none.
Fit reselect(const Rows& part, Fit fitted, const Rates& rates, const RefitOptions& options,
             OwnedCurves& curves);

}  // namespace rangecal::diagnosis
