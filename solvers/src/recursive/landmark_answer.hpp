// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "rangecal/core/outcome.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"
#include "recursive/landmark_sums.hpp"

namespace rangecal {

/// Where an estimate of RecursiveLandmarks ended.
struct RecursiveLandmarks::Answer {
  Outcome outcome = Outcome::failed;
  std::string reason, weakest_direction, covariance_reason;
  int order = 0, iterations = 0;
  JointState state;  ///< alpha of all coefficients, those above `order` 0; the stops held
  Eigen::Vector2d log_sigmas = Eigen::Vector2d::Zero();
  double nll = 0.0;      ///< l_s [nats]
  bool at_edge = false;  ///< a sigma is held at the end of the interval in which the stops were summed up
  std::optional<LandmarkSums>
      held;  ///< the stops held, expanded there but for the last step; none without sums
  /// Converged, and not only as far as the sums reach.
  bool settled() const { return outcome == Outcome::converged && !at_edge; }
  std::optional<Eigen::MatrixXd> covariance;  ///< of (alpha, landmarks, log sigma_e, log sigma_theta)
};

/// phi_0 of the sums, followed by the landmarks that they do not know yet.
Eigen::VectorXd reference_with(const LandmarkSums& sums, const JointState& state);

/// [low, high] widened by the distances of the problem's cells at `state` [m].
std::pair<double, double> distances_of(const JointProblem& problem, const JointState& state, double low,
                                       double high);

}  // namespace rangecal
