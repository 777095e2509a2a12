// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "fit_view.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::report {

/// What each finding was located by, before and after: residuals along a covariate, or what speaks of tails,
/// dependence, grids, missing readings and stops; the first `most` that can be drawn. `recorded` has the
/// labels as recorded, `before` those that the model reads; `after` is null where nothing was added. Returns
/// how many were drawn.
int add_findings(Page& page, const Diagnosis& diagnosis, const FitView& recorded, const FitView& before,
                 const FitView* after, int most);

/// The covariates that the findings were located along.
std::vector<std::string> covariates_of(const Diagnosis& diagnosis);

}  // namespace rangecal::report
