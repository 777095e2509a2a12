// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>

#include "rangecal/core/outcome.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"
#include "recursive/landmark_sums.hpp"
#include "robust/residual_shape.hpp"

namespace rangecal {

/// Where an estimate of RecursiveLandmarks ended.
struct RecursiveLandmarks::Answer {
  Outcome outcome = Outcome::failed;
  std::string reason, weakest_direction, covariance_reason;
  int order = 0, iterations = 0;
  JointState state;  ///< alpha with all coefficients, those above `order` being 0; the stops that are held
  Eigen::Vector2d log_sigmas = Eigen::Vector2d::Zero();
  double nll = 0.0;      ///< l_s [nats]
  bool at_edge = false;  ///< a sigma is held at the end of the interval in which the stops were summed up
  std::optional<LandmarkSums>
      held;  ///< expansion of the stops held, about `state` before the last step; none without sums
  /// Converged, and no sigma ended at the edge of the interval that the sums cover.
  bool settled() const { return outcome == Outcome::converged && !at_edge; }
  std::optional<Eigen::MatrixXd> covariance;  ///< of (alpha, landmarks, log sigma_e, log sigma_theta)
  std::optional<RobustShapes> shapes;         ///< none: Gaussian noise
  Eigen::MatrixXd gap;                        ///< as RecursiveLandmarks keeps it, of the stops held
  int outliers = 0;                           ///< among the readings held
};

/// phi_0 of the sums, followed by the landmarks that the sums do not contain yet.
Eigen::VectorXd reference_with(const LandmarkSums& sums, const JointState& state);

/// Number of readings that are more likely outliers than not, under the shape of range or bearing.
int outliers_among(const JointProblem& rows, const JointState& state, const RobustShapes& shapes);

/// Errors of the rows at `state` in units of their spreads, by channel, corrected for the part that the estimated poses absorb
/// (PoseLeverage). Empty if a distance or a spread is not positive.
std::pair<ChannelResiduals, ChannelResiduals> residuals_of(const JointProblem& rows, const JointState& state);

/// [low, high] widened by the distances of the problem's cells at `state` [m].
std::pair<double, double> distances_of(const JointProblem& problem, const JointState& state, double low,
                                       double high);

}  // namespace rangecal
