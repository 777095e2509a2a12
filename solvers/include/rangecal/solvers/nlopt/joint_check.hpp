// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/nlopt/nlopt_check.hpp"

namespace rangecal {

struct JointCheck {
  bool done = false;  ///< false: not tried, for `reason`
  std::string reason;
  NloptCheck result;  ///< its x counts from the seed: globals, then stop coordinates, in JointLayout's order
  JointState state;   ///< the best point
};

/// Minimises the joint NLL over all unknowns (alpha, noise, sigma_theta, stops, landmarks) a second time, by NLopt from
/// the seed, with the gradient of JointSystem, in coordinates whitened by the expected information at the seed; then
/// searches alpha globally, all else at its optimum given alpha, within +-0.3 of the largest reading over the range.
/// reference_nll: that of the solver under check [nats]; NaN: none.
/// Not done where the likelihood has no maximum and beyond max_check_unknowns (SLSQP factors a dense matrix of that
/// size at every step).
/// Throws InputError where the seed lies outside of the domain. Cost: some thousand passes over the cells.
JointCheck check_joint(const JointProblem& problem, const JointState& seed, double reference_nll,
                       NloptOptions options = {});

inline constexpr int max_check_unknowns = 400;

}  // namespace rangecal
