// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

#include "closed_form/curve_covariance.hpp"
#include "closed_form/landmark_map.hpp"

namespace rangecal {

namespace {

/// Landmarks by their bearings, or by their ranges where there are no bearings, and how much each cell weighed.
struct PlacedLandmarks {
  LandmarkMap map;
  Outcome outcome = Outcome::failed;
  std::string reason;
  double sigma_theta_rad = 0.0;
  std::vector<double> line_weights;  ///< of the cells' lines of sight; empty where ranges place the landmarks

  double across_of(const RangeSample& s) const {
    return line_weights.empty() ? 0.0 : line_weights[static_cast<std::size_t>(s.cell)];
  }
  double along_of(const RangeSample& s) const { return line_weights.empty() ? s.R : 0.0; }
};

PlacedLandmarks placed_landmarks(const JointProblem& problem, const ClosedFormOptions& options) {
  if (!problem.reads_bearings) {
    LandmarksFromRanges found = landmarks_from_ranges(problem);
    return {map_from(found), found.outcome, found.reason, SilentBearing::sigma_theta_rad, {}};
  }
  LandmarksFromBearings found = landmarks_from_bearings(problem, options.bearings);
  return {map_from(problem, found), found.outcome, found.reason, found.sigma_theta_rad,
          std::move(found.cell_weights)};
}

}  // namespace

Calibration closed_form_calibration(const JointProblem& problem, const ClosedFormOptions& options) {
  Calibration result = begun_calibration(problem, Method::closed_form);
  if (result.outcome == Outcome::too_few_data) return result;
  const PlacedLandmarks placed = placed_landmarks(problem, options);
  const LandmarkMap& map = placed.map;
  result.outcome = placed.outcome;
  result.reason = placed.reason;
  if (placed.outcome == Outcome::unobservable) result.weakest_direction = placed.reason;
  if (std::none_of(map.used.begin(), map.used.end(), [](char used) { return used; })) {
    result.reason = fmt::format("no landmark is determined by its {}: {}",
                                problem.reads_bearings ? "bearings" : "ranges", placed.reason);
    return result;
  }
  const std::vector<StopVariance> stops = stop_variances(problem, options.bearings.sigma_s_m);
  const std::vector<RangeSample> samples = samples_at(problem, map, stops);
  RangeModel model =
      fit_range_model(samples, RangeWeighting::ordinary, map.covariance, options.order, options);
  fill_sigma_theta(problem, map, stops, options, result);
  if (is_usable(model.outcome)) {
    std::vector<CellWeights> weights;
    for (const RangeSample& s : samples)
      weights.push_back({weight_of(s, RangeWeighting::ordinary), placed.across_of(s), placed.along_of(s),
                         !problem.reads_bearings});
    const double sigma_theta =
        result.sigma_theta_rad ? result.sigma_theta_rad->value : placed.sigma_theta_rad;
    model.alpha_covariance =
        curve_covariance(problem, samples, weights, model, sigma_theta, options.bearings.sigma_s_m);
  }
  fill_calibration(problem, map, model, samples, result);
  return result;
}

JointState state_at_landmarks(const JointProblem& problem, const std::vector<Eigen::Vector2d>& landmarks,
                              const ClosedFormOptions& options) {
  LandmarkMap map;
  map.position = landmarks;
  map.covariance.assign(landmarks.size(), Eigen::Matrix2d::Zero());
  map.used.assign(landmarks.size(), 1);
  const std::vector<StopVariance> stops = stop_variances(problem, options.bearings.sigma_s_m);
  const std::vector<RangeSample> samples = samples_at(problem, map, stops);
  JointState state;
  const int order = std::max(options.order.value_or(1), 0);
  state.alpha = Eigen::VectorXd::Zero(order + 1);
  state.alpha(std::min(order, 1)) = 1.0;
  state.noise.law = options.noise_law;
  state.noise.parameters = Eigen::VectorXd::Constant(1, 0.02);
  const RangeModel model = fit_range_model(samples, RangeWeighting::ordinary, {}, options.order, options);
  if (is_usable(model.outcome)) {
    state.alpha = model.alpha;
    if (model.noise.parameters.cwiseAbs().maxCoeff() > 0.0) state.noise = model.noise;
  }
  if (!problem.reads_bearings) {
    state.sigma_theta_rad = SilentBearing::sigma_theta_rad;
  } else if (options.bearings.sigma_theta_rad) {
    state.sigma_theta_rad = *options.bearings.sigma_theta_rad;
  } else if (const auto estimate = sigma_theta_at(problem, map, stops)) {
    state.sigma_theta_rad = estimate->value;
  }
  if (problem.estimate_sigma_s) {
    for (int k = 0; k < problem.stop_count(); ++k) {
      if (problem.sigma_s_shared[k])
        state.sigma_s_m = options.bearings.sigma_s_m.value_or(problem.stops[k].sigma_xy_m);
    }
  }
  for (const StopPrior& prior : problem.stops) state.stops.push_back(prior.commanded);
  state.landmarks = landmarks;
  return state;
}

JointState closed_form_state(const JointProblem& problem, const ClosedFormOptions& options) {
  return state_at_landmarks(problem, placed_landmarks(problem, options).map.position, options);
}

}  // namespace rangecal
