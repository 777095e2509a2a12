// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "diagnosis/signatures.hpp"
#include "rangecal/solvers/plan/plan.hpp"

namespace rangecal::plan {

/// The expected readings of a design; without `every_repeat` one row for each (stop, landmark), which weighs as many.
diagnosis::Rows expected_rows(const PlanRequest& request, const PlanDesign& design, bool every_repeat,
                              JointState& state);

/// The parameters of an effect that are nuisances, at the point where their derivatives are taken.
struct Nuisance {
  diagnosis::ActiveEffect active;
  std::vector<int> indices;
};

/// The effects asked about, at their typical size, the rest of their parameters in the middle of what they may be.
std::vector<Nuisance> nuisances_of(const PlanRequest& request, const diagnosis::Rows& rows);

/// Largest standard deviation of a corrected distance [m]; infinity where the design determines no curve.
double criterion(const PlanRequest& request, const PlanDesign& design,
                 const std::vector<Nuisance>& nuisances);

}  // namespace rangecal::plan
