// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// Distances d from stop to landmark by which readings can be judged, since they use no range: landmarks m at the maximum of the
/// marginal likelihood of bearings and commanded stops (along a random walk, steps) alone, stops s where they are likeliest given m,
/// sigma_theta and sigma_s as given,
///
///   d = |m - s| - radius,     var d = u^T (C_mm - C_ms - C_sm + C_ss) u,     u = (m - s) / |m - s|,
///
/// C the covariance of (m, s) there. (The joint maximum over m and s draws landmarks nearer: by 1.2 % of d in
/// a simulated walk of 40 steps of 1 cm and 0.6 degrees.)
class ReferenceDistances {
 public:
  /// `state`: the sigmas, and where the search begins. All unknown if it finds no maximum. Cost: linear in the cells times the
  /// landmarks of a recording.
  ReferenceDistances(const JointProblem& problem, const JointState& state);

  /// d [m] and var d [m^2] of a cell; none where bearings leave d uncertain by more than a tenth of it.
  struct Distance {
    double d_m, variance_m2;
  };
  std::optional<Distance> at(std::size_t cell) const { return distances_[cell]; }
  /// Variance of sum_i q_i d_i, one q per cell, zero where d is unknown: distances share the errors of landmarks and stops.
  double variance_of_sum(const std::vector<double>& q) const;

 private:
  void find_variances();
  Eigen::Vector2d sight(std::size_t cell) const;

  JointProblem bearings_;
  JointFit fit_;
  JointSystem system_;
  std::vector<std::optional<Distance>> distances_;
};

}  // namespace rangecal
