// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "fit_view.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::report {

/// Residuals before and after along what each finding was located along, the first `most` of them that have
/// one. `after` is null where nothing was added to the model. Returns how many were drawn.
int add_findings(Page& page, const Diagnosis& diagnosis, const FitView& before, const FitView* after,
                 int most);

/// The covariates that the findings were located along.
std::vector<std::string> covariates_of(const Diagnosis& diagnosis);

}  // namespace rangecal::report
