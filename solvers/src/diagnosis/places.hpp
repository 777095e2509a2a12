// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnosis/rows.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// Interval of a covariate.
struct Interval {
  double from = 0.0, to = 0.0;
};

/// Where a change acts: the shortest interval of x that holds all readings that it changes by half of its largest change
/// or more. None where it changes none, or x is missing in all that it changes. `circular`: x are angles [rad], and from > to
/// where the interval holds pi. Cost: that of sorting the readings.
std::optional<Interval> interval_of(const Eigen::VectorXd& x, const Eigen::VectorXd& change,
                                    bool circular = false);

/// The same of binned residuals, where no model of the change is known: the bins whose mean is half of the largest or
/// more, and two standard errors or more where any is. Bins meet half-way between their centres.
std::optional<Interval> interval_of(const std::vector<BinnedResidual>& bins);

/// Gives a finding its place from the change that it makes of every row: the interval of its covariate, or for landmarks
/// the labels of those that are changed by half as much (RMS) as the one that is changed most, or more. One that has its
/// place keeps it, ended where the covariate ends.
void place_by_change(const Rows& rows, const CellGeometry& geometry, const Eigen::VectorXd& change,
                     Finding& finding);

/// Ends a place that is open, or runs beyond the covariate's own values, where they end.
void close_place(const Rows& rows, const CellGeometry& geometry, Finding& finding);

/// Places of findings that have none yet, by their binned residuals; of those that are left, why they have none.
void place_by_residuals(const Rows& rows, std::vector<Finding>& location);

}  // namespace rangecal::diagnosis
