// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/core/noise.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// A start for recordings whose stops are a random walk: odometry that adds up ends far from where it was
/// meant to, and landmarks placed from there lie anywhere. Stop after stop is found by what it sees of the
/// landmarks placed so far (LandmarkFilter over a line for f, known to a tenth, in the scale of the mean
/// reading); then the curve as position_seed has it. Throws InputError for fewer cells than coefficients.
/// Cost: the cells times the square of the landmarks.
JointState walk_seed(const JointProblem& problem, int order, NoiseLaw law);

/// True if some stop's error adds to that of the stop before.
bool is_walk(const JointProblem& problem);

}  // namespace rangecal
