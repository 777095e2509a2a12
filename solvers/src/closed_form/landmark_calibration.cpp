// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <set>

#include "closed_form/moments.hpp"
#include "closed_form/range_model.hpp"
#include "closed_form/stop_variance.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

/// Landmarks as the sweeps see them; `used` are those whose position is determined.
struct Map {
  std::vector<Vector2d> position;
  std::vector<Matrix2d> covariance;
  std::vector<char> used;
};

Vector2d commanded(const JointProblem& problem, int stop) {
  return {problem.stops[stop].commanded.x_m, problem.stops[stop].commanded.y_m};
}

std::vector<RangeSample> samples_at(const JointProblem& problem, const Map& map,
                                    const std::vector<StopVariance>& stops) {
  const Cells& cells = problem.cells;
  std::vector<RangeSample> samples;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const int l = cells.landmark[c];
    if (!map.used[l]) continue;
    const Vector2d v = map.position[l] - commanded(problem, cells.stop[c]);
    const double d = v.norm() - cells.radius_m[c];
    if (!(d > 0.0)) continue;   // a stop inside the landmark: the position is not that good
    samples.push_back({d, cells.range_mean[c], cells.count[c], cells.range_mean_square[c],
                       stops[cells.stop[c]].xy_sq, l, static_cast<int>(c), v.normalized()});
  }
  return samples;
}

int places_with_cells(const JointProblem& problem) {
  std::set<int> places;
  for (const int stop : problem.cells.stop) places.insert(problem.stops[stop].place);
  return static_cast<int>(places.size());
}

void append(std::string& text, const std::string& more) {
  if (more.empty()) return;
  if (!text.empty()) text += "; ";
  text += more;
}

/// sigma_theta with its standard deviation, from the moments of the angles at the map.
std::optional<Estimate> sigma_theta_at(const JointProblem& problem, const Map& map,
                                       const std::vector<StopVariance>& stops) {
  const Cells& cells = problem.cells;
  std::vector<MomentTerm> terms;
  double within = 0.0, dof = 0.0;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const int l = cells.landmark[c], k = cells.stop[c];
    within += cells.count[c] * cells.bearing_mean_square[c];
    dof += cells.count[c] - 1.0;
    if (!map.used[l]) continue;
    const Vector2d v = map.position[l] - commanded(problem, k);
    const double phi = problem.stops[k].commanded.heading_rad + cells.bearing_mean[c];
    const double angle = std::atan2(std::cos(phi) * v.y() - std::sin(phi) * v.x(),
                                    std::cos(phi) * v.x() + std::sin(phi) * v.y());
    terms.push_back({angle * angle, 1.0 / cells.count[c], stops[k].xy_sq / v.squaredNorm() + stops[k].heading_sq});
    dof += 1.0;
  }
  for (const char used : map.used) dof -= used ? 2.0 : 0.0;
  const double variance = variance_from_moments(terms, within, dof);
  if (!(variance > 0.0)) return std::nullopt;
  return Estimate{std::sqrt(variance), std::sqrt(variance / (2.0 * dof))};
}

Map map_from(const JointProblem& problem, const LandmarksFromBearings& found) {
  const auto raw = landmarks_from_positions(problem);
  Map map;
  for (std::size_t l = 0; l < found.landmarks.size(); ++l) {
    const bool used = found.landmarks[l].outcome == Outcome::converged;
    map.used.push_back(used);
    map.position.push_back(used ? found.landmarks[l].position_m : raw[l].value_or(Vector2d::Zero()));
    map.covariance.push_back(used ? found.landmarks[l].covariance : Matrix2d::Zero());
  }
  return map;
}

/// Outcome and reason where no calibration can come of the problem at all.
std::optional<std::string> hopeless(const JointProblem& problem) {
  const int places = places_with_cells(problem);
  if (places >= 3) return std::nullopt;
  return std::to_string(places) + " place(s) to stand: lines of sight have no redundancy with fewer than 3";
}

void fill(const JointProblem& problem, const Map& map, const RangeModel& model,
          const std::vector<RangeSample>& samples, Calibration& result) {
  append(result.reason, model.reason);
  for (int l = 0; l < problem.landmark_count(); ++l) {
    LandmarkEstimate estimate;
    estimate.recording = problem.landmark_recording[l];
    estimate.position_m = map.position[l];
    if (map.used[l]) estimate.covariance = map.covariance[l];
    result.landmarks.push_back(estimate);
  }
  if (!is_usable(model.outcome)) {
    result.outcome = model.outcome;
    return;
  }
  append(result.reason, model.note);
  result.alpha = model.alpha;
  result.alpha_covariance = model.alpha_covariance;
  result.noise = model.noise;
  result.noise_estimates = model.noise_estimates;
  const auto by_distance = [](const RangeSample& a, const RangeSample& b) { return a.d < b.d; };
  result.range_min_m = std::min_element(samples.begin(), samples.end(), by_distance)->d;
  result.range_max_m = std::max_element(samples.begin(), samples.end(), by_distance)->d;
}

void set_sigma_theta(const JointProblem& problem, const Map& map, const std::vector<StopVariance>& stops,
                     const ClosedFormOptions& options, Calibration& result) {
  if (options.bearings.sigma_theta_rad) {
    result.sigma_theta_rad = Estimate{*options.bearings.sigma_theta_rad, std::nullopt};
    return;
  }
  result.sigma_theta_rad = sigma_theta_at(problem, map, stops);
  if (!result.sigma_theta_rad)
    append(result.reason, "sigma_theta cannot be told from the errors of the stops: none is given");
}

/// What the weights of a sweep are made of.
struct SweepNoise {
  double sigma_theta_sq;
  const RangeModel& model;
};

/// d^: the root of f(d) = y nearest to the present distance; that distance where there is no root within half of it.
double invert_near(const Eigen::VectorXd& alpha, double y, double d) {
  Eigen::VectorXd shifted = alpha;
  shifted(0) -= y;
  double best = d, gap = 0.5 * d;
  for (const double root : real_roots(shifted, 0.5 * d, 1.5 * d)) {
    if (std::abs(root - d) < gap) {
      best = root;
      gap = std::abs(root - d);
    }
  }
  return best;
}

/// Moves every used landmark; returns the largest move in standard deviations.
double sweep_landmarks(const JointProblem& problem, const std::vector<StopVariance>& stops,
                       const std::vector<RangeSample>& samples, const SweepNoise& noise, Map& map) {
  const Cells& cells = problem.cells;
  std::vector<Matrix2d> A(map.position.size(), Matrix2d::Zero());
  std::vector<Vector2d> b(map.position.size(), Vector2d::Zero());
  for (const RangeSample& s : samples) {
    const int k = cells.stop[s.cell];
    const double phi = problem.stops[k].commanded.heading_rad + cells.bearing_mean[s.cell];
    const double axis = s.d + cells.radius_m[s.cell];
    const Vector2d along(std::cos(phi), std::sin(phi)), across(std::sin(phi), -std::cos(phi));
    const Vector2d from = commanded(problem, k) - map.position[s.landmark];   // relative to the present position
    const double across_variance =
        stops[k].xy_sq + (noise.sigma_theta_sq / s.R + stops[k].heading_sq) * axis * axis + 1e-18;
    A[s.landmark] += across * across.transpose() / across_variance;
    b[s.landmark] += across * across.dot(from) / across_variance;
    const double slope = evaluate_derivative(noise.model.alpha, s.d);
    if (std::abs(slope) < 1e-3) continue;   // the range says nothing about the distance here
    const double spread = noise.model.noise.spread(s.d, evaluate_polynomial(noise.model.alpha, s.d)) / slope;
    const double along_variance = stops[k].xy_sq + spread * spread / s.R + 1e-18;
    const double range = invert_near(noise.model.alpha, s.y, s.d) + cells.radius_m[s.cell];
    A[s.landmark] += along * along.transpose() / along_variance;
    b[s.landmark] += along * (along.dot(from) + range) / along_variance;
  }
  double largest = 0.0;
  for (std::size_t l = 0; l < A.size(); ++l) {
    if (!map.used[l] || !(A[l].determinant() > 0.0)) continue;
    map.covariance[l] = A[l].inverse();
    const Vector2d step = map.covariance[l] * b[l];
    map.position[l] += step;
    largest = std::max(largest, std::sqrt(step.dot(A[l] * step)));
  }
  return largest;
}

}  // namespace

Calibration closed_form_calibration(const JointProblem& problem, const ClosedFormOptions& options) {
  Calibration result;
  result.method = Method::closed_form;
  result.covariance_reason =
      "first order, at the commanded stops; the bend that errors in the distances put into f is not in it";
  if (const auto why = hopeless(problem)) {
    result.outcome = Outcome::too_few_data;
    result.reason = *why;
    return result;
  }
  const LandmarksFromBearings found = landmarks_from_bearings(problem, options.bearings);
  const Map map = map_from(problem, found);
  result.outcome = found.outcome;
  result.reason = found.reason;
  if (std::none_of(map.used.begin(), map.used.end(), [](char used) { return used; })) {
    result.outcome = Outcome::too_few_data;
    result.reason = "no landmark is determined by its bearings: " + found.reason;
    return result;
  }
  if (found.outcome == Outcome::unobservable) result.weakest_direction = found.reason;
  const std::vector<StopVariance> stops = stop_variances(problem, options.bearings.sigma_s_m);
  const std::vector<RangeSample> samples = samples_at(problem, map, stops);
  const RangeModel model =
      fit_range_model(samples, RangeWeighting::ordinary, map.covariance, options.order, options);
  fill(problem, map, model, samples, result);
  set_sigma_theta(problem, map, stops, options, result);
  return result;
}

Calibration approximate_joint_calibration(const JointProblem& problem, const ClosedFormOptions& options) {
  Calibration result;
  result.method = Method::approximate;
  result.covariance_reason = "that of the last step: landmarks and curve are fitted to the same ranges, unseen by it";
  if (const auto why = hopeless(problem)) {
    result.outcome = Outcome::too_few_data;
    result.reason = *why;
    return result;
  }
  const LandmarksFromBearings found = landmarks_from_bearings(problem, options.bearings);
  Map map = map_from(problem, found);
  for (std::size_t l = 0; l < map.used.size(); ++l) map.used[l] = found.landmarks[l].cells >= 2;
  const std::vector<StopVariance> stops = stop_variances(problem, options.bearings.sigma_s_m);
  double sigma_theta = found.sigma_theta_rad;
  std::optional<int> order = options.order;
  RangeModel model;
  std::vector<RangeSample> samples;
  double move = 0.0;
  result.outcome = Outcome::not_converged;
  for (result.iterations = 0; result.iterations < options.max_sweeps;) {
    samples = samples_at(problem, map, stops);
    model = fit_range_model(samples, RangeWeighting::d_squared, map.covariance, order, options);
    if (!is_usable(model.outcome)) break;
    order = static_cast<int>(model.alpha.size()) - 1;   // chosen once, then kept
    if (!options.bearings.sigma_theta_rad) {
      if (const auto estimate = sigma_theta_at(problem, map, stops)) sigma_theta = estimate->value;
    }
    ++result.iterations;
    move = sweep_landmarks(problem, stops, samples, {sigma_theta * sigma_theta, model}, map);
    if (!std::isfinite(move)) break;
    if (move < options.sweep_tolerance) {
      result.outcome = Outcome::converged;
      break;
    }
  }
  if (!std::isfinite(move)) {
    result.outcome = Outcome::failed;
    result.reason = "a landmark left the finite plane";
    return result;
  }
  if (is_usable(model.outcome)) {
    samples = samples_at(problem, map, stops);
    model = fit_range_model(samples, RangeWeighting::d_squared, map.covariance, order, options);
  }
  fill(problem, map, model, samples, result);
  set_sigma_theta(problem, map, stops, options, result);
  if (result.outcome == Outcome::not_converged)
    append(result.reason, "landmarks still move by " + std::to_string(move) + " standard deviations after " +
                              std::to_string(result.iterations) + " sweeps");
  return result;
}

JointState state_at_landmarks(const JointProblem& problem, const std::vector<Vector2d>& landmarks,
                              const ClosedFormOptions& options) {
  Map map;
  map.position = landmarks;
  map.covariance.assign(landmarks.size(), Matrix2d::Zero());
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
      if (problem.sigma_s_shared[k]) state.sigma_s_m = options.bearings.sigma_s_m.value_or(problem.stops[k].sigma_xy_m);
    }
  }
  for (const StopPrior& prior : problem.stops) state.stops.push_back(prior.commanded);
  state.landmarks = landmarks;
  return state;
}

JointState closed_form_state(const JointProblem& problem, const ClosedFormOptions& options) {
  return state_at_landmarks(problem, map_from(problem, landmarks_from_bearings(problem, options.bearings)).position,
                            options);
}

}  // namespace rangecal
