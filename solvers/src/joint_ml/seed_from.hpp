// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {

/// Curve, noise and sigma_theta of a start that has stops and landmarks and a noise law; where a stop stands
/// inside a landmark that it sees, stops and landmarks are moved apart first. Throws InputError for fewer
/// cells than coefficients.
void seed_from_places(const JointProblem& problem, int order, JointState& state);

}  // namespace rangecal
