// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// The distances of the problem's cells at `state`, as the range of a calibration.
void fill_range(const JointProblem& problem, const JointState& state, Calibration& result);

/// Why the recording does not determine the curve, in words: distances that do not differ, or a standard
/// deviation of f (by the expected information at `state`) beyond a quarter of the distance. None where f is
/// determined, and for a curve without a slope, which is not checked.
std::optional<std::string> unobservable_reason(const JointProblem& problem, const JointState& state);

/// Turns a calibration into the outcome `unobservable`, standard deviations removed; where it had no curve it
/// gets that of `state`, one of the many that explain the readings. `too_few_data` stays.
void mark_unobservable(const JointProblem& problem, const std::string& reason, const JointState& state,
                       Calibration& calibration);

}  // namespace rangecal
