// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "fit_view.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::report {

/// Charts of a finding that is no mean or spread along a covariate: quantiles for tails, a reading against
/// its next repeat for dependence, distinct values for grids, readings present for detection, moves of the
/// stops. `id` begins the charts' names. `after` is null where nothing was added to the model. Empty where
/// there is nothing to draw.
std::vector<Chart> charts_beyond_means(Page& page, const std::string& id, const Finding& finding,
                                       const FitView& before, const FitView* after);

}  // namespace rangecal::report
