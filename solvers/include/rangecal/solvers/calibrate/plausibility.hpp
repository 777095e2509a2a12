// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// What the readers of the recordings noted (Recording::notes, each once), and what a person would ask on seeing such a
/// recording and the curve fitted to it, one sentence each:
///   - readings and distances that differ by more than a factor of twenty, as they do when a file is in
///     millimetres; any factor fits a polynomial, so nothing else would say so;
///   - readings of which more than half lie above the sensor's range;
///   - repeats that are the same to the last digit in every cell: a simulation without noise, or steps far
///     coarser than the noise. Of such readings no likelihood has a maximum worth its name;
///   - readings too few for a noise shape of its own (noise_shape_warning).
std::vector<std::string> plausibility_warnings(std::span<const Recording> recordings,
                                               const Calibration& calibration);

/// Fewer than 100 readings, and tails estimated along: intervals that are too narrow, with what they hold
/// (docs/reliability.md). Empty where that is not so.
std::string noise_shape_warning(const Calibration& calibration);

/// The first of these that needs no curve: readings above the sensor's range. Empty where there are few.
std::string range_limit_warning(std::span<const Recording> recordings);

/// Lowest order, up to `highest`, of a curve on which all readings lie, seen from where the closed form has
/// landmarks and the stops as stated; none where there is noise.
std::optional<int> order_without_noise(const JointProblem& problem, int lowest, int highest);

/// What is said of such readings.
std::string without_noise(int order);

}  // namespace rangecal
