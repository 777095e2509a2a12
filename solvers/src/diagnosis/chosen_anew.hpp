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

/// Curves without a name get their knots and smoothness anew from `part`, or go where it shows none.
///
/// What the search chose among the starts of a grid (a period, a stop, a landmark, a time constant) is chosen
/// anew from `part` alone, one effect after the other, the rest held: the highest scores over the effect's
/// grid are refitted, and the best of them is kept where it beats `fitted`, the model fitted to the part with
/// the choices of all readings.
Fit chosen_anew(const Rows& part, Fit fitted, const Rates& rates, const RefitOptions& options,
                OwnedCurves& curves);

}  // namespace rangecal::diagnosis
