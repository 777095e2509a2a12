// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// How far a stop may be from its commanded pose: P, covariance of (x, y, heading) in the world's frame
/// [m^2, m rad, rad^2].
struct StopVariance {
  Eigen::Matrix3d P = Eigen::Matrix3d::Zero();

  /// Variance of the position along a unit vector u [m^2].
  double along(const Eigen::Vector2d& u) const {
    return P(0, 0) * u.x() * u.x() + 2.0 * P(0, 1) * u.x() * u.y() + P(1, 1) * u.y() * u.y();
  }
  /// Variance [m^2] of the perpendicular offset, at distance d, of a line of sight drawn from the commanded pose, from the stop's error
  /// alone (2021 eq. 24 without the bearing's noise). `across` = (sin phi, -cos phi); an error e_h of the heading contributes -d e_h.
  double off_line(const Eigen::Vector2d& across, double d) const {
    return along(across) - 2.0 * d * (P(0, 2) * across.x() + P(1, 2) * across.y()) + d * d * P(2, 2);
  }
};

/// Covariance after one more step of a random walk. That of the step, with sigma_xy as given and turned into the world's frame by the
/// previous commanded heading where it has a shape, is added; a turn on the spot adds no error of the position; without `turns_add_up` the
/// heading's error is that of this step alone. What an earlier error of the heading does to later positions is left out.
inline Eigen::Matrix3d after_step(const Eigen::Matrix3d& before, const StopPrior& step, double sigma_xy_m,
                                  double heading_before_rad) {
  Eigen::Matrix3d P = covariance_of(step, sigma_xy_m);
  if (!step.opens_place) {  // turned, not moved
    P.topLeftCorner<2, 2>().setZero();
  } else if (step.shape) {
    Eigen::Matrix3d turn = Eigen::Matrix3d::Identity();
    turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(heading_before_rad).toRotationMatrix();
    P = turn * P * turn.transpose();
  }
  Eigen::Matrix3d sum = before + P;
  if (!step.turns_add_up) {
    sum.row(2) = P.row(2);
    sum.col(2) = P.col(2);
  }
  return sum;
}

/// Covariance of every stop; `sigma_s_m` replaces the sigma_xy of stops without a covariance of their own. Stops of one place share its
/// position error; along a random walk the covariances of the steps add up.
inline std::vector<StopVariance> stop_variances(const JointProblem& problem,
                                                std::optional<double> sigma_s_m) {
  std::vector<StopVariance> variances(problem.stops.size());
  std::vector<int> opener(problem.place_count, 0);
  for (std::size_t k = 0; k < variances.size(); ++k) {
    const StopPrior& prior = problem.stops[k];
    const double sigma_xy_m = prior.shape ? prior.sigma_xy_m : sigma_s_m.value_or(prior.sigma_xy_m);
    Eigen::Matrix3d& P = variances[k].P;
    if (prior.opens_place) opener[prior.place] = static_cast<int>(k);
    if (prior.chained && k > 0) {
      P = after_step(variances[k - 1].P, prior, sigma_xy_m, problem.stops[k - 1].commanded.heading_rad);
      continue;
    }
    P = covariance_of(prior, sigma_xy_m);
    if (!prior.opens_place) P.topLeftCorner<2, 2>() = variances[opener[prior.place]].P.topLeftCorner<2, 2>();
  }
  return variances;
}

}  // namespace rangecal
