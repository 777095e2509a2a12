// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// Moves the stops of `state` to their conditional optimum, or to where the square of Newton's decrement is below `enough`, and
/// leaves `system` assembled (exact) and eliminated there. Returns the joint NLL, or +infinity if no positive definite optimum was
/// found. Adds to `evaluations`.
double settle_stops(JointSystem& system, JointState& state, int& evaluations, double enough = 0.0);

/// Laplace's marginal NLL from a settled system.
double laplace_nll(const JointSystem& system, double joint_nll);

/// The same of the stops where `state` has them, which should be near their conditional optimum; +infinity outside the model's domain.
double laplace_nll_at(const JointProblem& problem, const JointState& state);

}  // namespace rangecal
