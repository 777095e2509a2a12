// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/observability.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <limits>

#include "rangecal/solvers/calibrate/curve.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"

namespace rangecal {

void fill_range(const JointProblem& problem, const JointState& state, Calibration& result) {
  const Cells& cells = problem.cells;
  double low = std::numeric_limits<double>::infinity(), high = 0.0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const Pose2& pose = state.stops[cells.stop[i]];
    const double d =
        (state.landmarks[cells.landmark[i]] - Eigen::Vector2d(pose.x_m, pose.y_m)).norm() - cells.radius_m[i];
    low = std::min(low, d);
    high = std::max(high, d);
  }
  result.range_min_m = std::max(0.0, low);
  result.range_max_m = high;
}

std::optional<std::string> unobservable_reason(const JointProblem& problem, const JointState& state) {
  if (state.alpha.size() < 2) return std::nullopt;
  Calibration at;
  at.alpha = state.alpha;
  at.noise = state.noise;
  fill_range(problem, state, at);
  double uncertain = problem.stops[0].sigma_xy_m;
  if (!problem.stops.back().chained)
    for (const StopPrior& prior : problem.stops) uncertain = std::max(uncertain, prior.sigma_xy_m);
  const double span = at.range_max_m - at.range_min_m;
  if (span < 0.02 * at.range_max_m)
    return fmt::format(
        "all readings are at about one distance ({:.2f} to {:.2f} m), so the slope of f is not determined",
        at.range_min_m, at.range_max_m);
  if (span < 8.0 * uncertain)
    return fmt::format(
        "sigma_xy_m lets a stop be off by {:.3g} m where the distances, {:.2f} to {:.2f} m, differ by less than eight "
        "times that, so the slope of f is not determined",
        uncertain, at.range_min_m, at.range_max_m);
  const auto bound = cramer_rao_bound(problem, state);
  if (!bound) return "the information matrix is singular: curve and landmarks can shift together unseen";
  at.alpha_covariance = bound->topLeftCorner(state.alpha.size(), state.alpha.size());
  for (const CurvePoint& point : curve_points(at))
    if (!(*point.std_dev_m < 0.25 * std::max(point.distance_m, 0.2 * at.range_max_m)))
      return fmt::format(
          "f is not determined (its standard deviation is {:.2g} m at {:.2f} m): curve and landmarks can "
          "shift together unseen",
          *point.std_dev_m, point.distance_m);
  return std::nullopt;
}

void mark_unobservable(const JointProblem& problem, const std::string& reason, const JointState& state,
                       Calibration& calibration) {
  if (calibration.outcome == Outcome::too_few_data) return;
  if (calibration.alpha.size() == 0) {
    calibration.alpha = state.alpha;
    calibration.noise = state.noise;
    fill_range(problem, state, calibration);
  }
  calibration.outcome = Outcome::unobservable;
  calibration.reason = reason;
  calibration.alpha_covariance.reset();
  calibration.covariance_with_choice.reset();
  calibration.covariance_reason = "no covariance: " + reason;
  for (Estimate& estimate : calibration.noise_estimates) estimate.std_dev.reset();
  for (LandmarkEstimate& landmark : calibration.landmarks) landmark.covariance.reset();
  if (calibration.weakest_direction.empty())
    calibration.weakest_direction = "alpha_0 against alpha_1 and the landmarks";
}

}  // namespace rangecal
