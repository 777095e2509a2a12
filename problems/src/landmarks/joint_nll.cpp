// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/joint_nll.hpp"

#include <cmath>
#include <limits>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// -log N(residual; 0, sigma^2)
double gaussian_nll(double residual, double sigma) {
  return 0.5 * residual * residual / (sigma * sigma) + std::log(sigma) + half_log_two_pi;
}

/// Prior of stop k: on its error, or, chained, on the increment from the stop before in that stop's frame.
double stop_nll(const JointProblem& problem, const JointState& state, int k) {
  const StopPrior& prior = problem.stops[k];
  const Pose2& pose = state.stops[k];
  Eigen::Vector2d error(pose.x_m - prior.commanded.x_m, pose.y_m - prior.commanded.y_m);
  double turn = pose.heading_rad - prior.commanded.heading_rad;
  if (prior.chained) {
    const StopPrior& before = problem.stops[k - 1];
    const Pose2& from = state.stops[k - 1];
    const Eigen::Vector2d step(pose.x_m - from.x_m, pose.y_m - from.y_m);
    const Eigen::Vector2d commanded(prior.commanded.x_m - before.commanded.x_m,
                                    prior.commanded.y_m - before.commanded.y_m);
    error = step - commanded;
    if (prior.turns_add_up) {
      turn -= from.heading_rad - before.commanded.heading_rad;
      error = Eigen::Rotation2Dd(-from.heading_rad) * step -
              Eigen::Rotation2Dd(-before.commanded.heading_rad) * commanded;
    }
  }
  const StopInformation information(prior, sigma_xy_of(problem, state, k));
  const Eigen::Vector3d e(error.x(), error.y(), wrap_angle(turn));
  return 0.5 * e.dot(information.W * e) + information.log_scale;
}

}  // namespace

JointNllParts joint_nll_parts(const JointProblem& problem, const JointState& state) {
  JointNllParts parts;
  const Cells& c = problem.cells;
  const double log_sigma_theta = std::log(state.sigma_theta_rad);
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  if (!(state.sigma_theta_rad > 0.0)) return {infinity, infinity, 0.0, 0.0};
  for (std::size_t i = 0; i < c.size(); ++i) {
    const Pose2& pose = state.stops[c.stop[i]];
    const Eigen::Vector2d sight = state.landmarks[c.landmark[i]] - Eigen::Vector2d(pose.x_m, pose.y_m);
    const double d = sight.norm() - c.radius_m[i];
    const double f = evaluate_polynomial(state.alpha, d);
    const double s = state.noise.spread(d, f);
    if (!(d > 0.0) || !(s > 0.0)) return {infinity, parts.bearing, 0.0, 0.0};
    const double range_error = c.range_mean[i] - f - c.effect_change(i, d);
    const double bearing_error =
        wrap_angle(c.bearing_mean[i] - std::atan2(sight.y(), sight.x()) + pose.heading_rad);
    parts.range += c.count[i] * (std::log(s) + half_log_two_pi) +
                   0.5 * c.range_weight[i] * (range_error * range_error + c.range_mean_square[i]) / (s * s);
    parts.bearing += c.count[i] * (log_sigma_theta + half_log_two_pi) +
                     0.5 * c.bearing_weight[i] * bearing_information *
                         (bearing_error * bearing_error + c.bearing_mean_square[i]);
  }
  parts.bearing -= silent_bearing_nll(problem);
  for (int k = 0; k < problem.stop_count(); ++k) parts.stops += stop_nll(problem, state, k);
  for (const KnownDistance& taped : problem.known_distances)
    parts.taped += gaussian_nll(
        (state.landmarks[taped.from] - state.landmarks[taped.to]).norm() - taped.distance_m, taped.sigma_m);
  return parts;
}

double joint_nll(const JointProblem& problem, const JointState& state) {
  const double nll = joint_nll_parts(problem, state).total();
  return std::isnan(nll) ? infinity : nll;
}

}  // namespace rangecal
