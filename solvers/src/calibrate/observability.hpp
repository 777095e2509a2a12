// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// The distances of the problem's cells at `state`, as the range of a calibration.
void fill_range(const JointProblem& problem, const JointState& state, Calibration& result);

/// Why the recording does not determine the curve, in words:
///   distances that do not differ;
///   distances that differ by less than eight times sigma_xy, the largest of the stops (along a random walk the first stop's);
///   a standard deviation of f, by the expected information at `state`, above a quarter of the distance.
/// None if f is determined, and for a curve of order 0, which is not checked.
std::optional<std::string> unobservable_reason(const JointProblem& problem, const JointState& state);

/// Sets the outcome `unobservable` and removes the standard deviations. A calibration without a curve gets the curve of
/// `state`, one of the many that explain the readings. The outcome `too_few_data` is left as it is.
void mark_unobservable(const JointProblem& problem, const std::string& reason, const JointState& state,
                       Calibration& calibration);

}  // namespace rangecal
