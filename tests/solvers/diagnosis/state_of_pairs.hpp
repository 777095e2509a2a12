// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/rows.hpp"

namespace rangecal::testing {

/// A state of known distances, which are laid out as stops on a line through one held landmark.
inline JointState state_of_pairs(const diagnosis::Rows& rows, const Eigen::VectorXd& alpha, NoiseLaw law,
                                 double sigma) {
  JointState state;
  state.alpha = alpha;
  state.noise = {law, Eigen::VectorXd::Constant(1, sigma)};
  state.sigma_theta_rad = 1.0;
  state.landmarks.assign(1, Eigen::Vector2d::Zero());
  for (const StopPrior& prior : rows.problem.stops) state.stops.push_back(prior.commanded);
  return state;
}

}  // namespace rangecal::testing
