// SPDX-License-Identifier: BSD-3-Clause
#include "recursive/pose_leverage.hpp"

#include <Eigen/LU>
#include <algorithm>

#include "rangecal/core/polynomial.hpp"

namespace rangecal {

PoseLeverage pose_leverage(const JointProblem& rows, const JointState& state) {
  using Eigen::Matrix3d;
  using Eigen::Vector3d;
  const Cells& c = rows.cells;
  const std::size_t count = c.size();
  PoseLeverage leverage{std::vector<double>(count), std::vector<double>(count)};
  std::vector<Vector3d> range(count), bearing(count);  // g / s
  for (std::size_t k = 0; k < rows.stops.size(); ++k) {
    const StopPrior& prior = rows.stops[k];
    const Pose2& pose = state.stops[k];
    Matrix3d P = covariance_of(prior, prior.sigma_xy_m), M = Matrix3d::Zero();
    if (!prior.opens_place) P.topLeftCorner<2, 2>().setZero();
    if (prior.chained) P *= 0.5;
    const auto begin = static_cast<std::size_t>(c.stop_begin[k]),
               end = static_cast<std::size_t>(c.stop_begin[k + 1]);
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector2d sight =
          state.landmarks[static_cast<std::size_t>(c.landmark[i])] - Eigen::Vector2d(pose.x_m, pose.y_m);
      const double D = sight.norm(), d = D - c.radius_m[i], f = evaluate_polynomial(state.alpha, d),
                   s = state.noise.spread(d, f), slope = evaluate_derivative(state.alpha, d);
      const Eigen::Vector2d n = sight / D;
      range[i] = Vector3d(-slope * n.x(), -slope * n.y(), 0.0) / s;
      bearing[i] = Vector3d(n.y() / D, -n.x() / D, -1.0) / state.sigma_theta_rad;
      M += c.count[i] * (range[i] * range[i].transpose() + bearing[i] * bearing[i].transpose());
    }
    const Matrix3d C = P * (Matrix3d::Identity() + M * P).inverse();
    for (std::size_t i = begin; i < end; ++i) {
      leverage.range[i] = std::clamp(range[i].dot(C * range[i]), 0.0, 1.0);
      leverage.bearing[i] = std::clamp(bearing[i].dot(C * bearing[i]), 0.0, 1.0);
    }
  }
  return leverage;
}

}  // namespace rangecal
