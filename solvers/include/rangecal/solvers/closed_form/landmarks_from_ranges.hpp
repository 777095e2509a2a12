// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

struct LandmarkFromRanges {
  Outcome outcome = Outcome::failed;  ///< converged; unobservable; too_few_data
  std::string reason;
  Eigen::Vector2d position_m = Eigen::Vector2d::Zero();  ///< only where converged
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  ///< [m^2], by the residuals (sandwich)
  /// The other place that fits as well (within chi-square 9), in the mirror of a path along a line.
  std::optional<Eigen::Vector2d> mirror_m;
};

struct LandmarksFromRanges {
  Outcome outcome = Outcome::failed;  ///< converged; unobservable (some are not); too_few_data (none is)
  std::string reason;
  std::vector<LandmarkFromRanges> landmarks;  ///< one per landmark of the problem
};

/// Landmark axes from ranges alone, read at the commanded stops: multilateration, the raw ranges taken for true. With the stops
/// p_k [m], rho_k = y_k + radius_l [m] of cell k and c = |m|^2,
///   rho_k^2 - |p_k|^2 = c - 2 p_k . m
/// is linear in (m, c) and solved by weighted least squares, weights R / rho^2 (an error e of rho moves rho^2 by 2 rho e); the origin
/// is the mean of the stops. Where the stops lie nearly on a line, the part of m across it is small beside its error: there it is
/// +-sqrt(c - m_along^2), and both are tried. Each solution is refined by Gauss-Newton on the ranges themselves,
///   min over m of sum w_k (rho_k - |m - p_k|)^2,
/// w_k = R / (1 + (r_k / 2.5 s)^2) with s the median absolute residual / 0.6745, so that single late echoes have no influence; the one
/// that fits best stands.
///
/// unobservable: stops at fewer than 3 places see it (2 places leave two points), or they stand at one point. Cost: linear in
/// the cells.
LandmarksFromRanges landmarks_from_ranges(const JointProblem& problem);

}  // namespace rangecal
