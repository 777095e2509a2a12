// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

#include <algorithm>

#include "closed_form/curve_covariance.hpp"
#include "closed_form/landmark_map.hpp"

namespace rangecal {

Calibration closed_form_calibration(const JointProblem& problem, const ClosedFormOptions& options) {
  Calibration result = begun_calibration(problem, Method::closed_form);
  if (result.outcome == Outcome::too_few_data) return result;
  const LandmarksFromBearings found = landmarks_from_bearings(problem, options.bearings);
  const LandmarkMap map = map_from(problem, found);
  result.outcome = found.outcome;
  result.reason = found.reason;
  if (found.outcome == Outcome::unobservable) result.weakest_direction = found.reason;
  if (std::none_of(map.used.begin(), map.used.end(), [](char used) { return used; })) {
    result.reason = "no landmark is determined by its bearings: " + found.reason;
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
      weights.push_back({weight_of(s, RangeWeighting::ordinary), found.cell_weights[s.cell], 0.0});
    const double sigma_theta = result.sigma_theta_rad ? result.sigma_theta_rad->value : found.sigma_theta_rad;
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
  if (options.bearings.sigma_theta_rad) {
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
  return state_at_landmarks(
      problem, map_from(problem, landmarks_from_bearings(problem, options.bearings)).position, options);
}

}  // namespace rangecal
