// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "closed_form/curve_covariance.hpp"
#include "closed_form/landmark_map.hpp"
#include "rangecal/core/polynomial.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

/// What the weights of a sweep are made of.
struct SweepNoise {
  double sigma_theta_sq;
  const RangeModel& model;
  bool reads_bearings;
};

/// d^: the root of f(d) = y nearest to the present distance; that distance where there is no root within half
/// of it.
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

/// Of a cell in the equations of a sweep. `axis`: distance to the landmark's axis [m].
CellWeights sweep_weights(const RangeSample& s, const StopVariance& stop, const Vector2d& across, double axis,
                          const SweepNoise& noise) {
  CellWeights weights;
  weights.curve = weight_of(s, RangeWeighting::d_squared);
  if (noise.reads_bearings)
    weights.across = 1.0 / (stop.off_line(across, axis) + (noise.sigma_theta_sq / s.R + 1e-18) * axis * axis);
  const double slope = evaluate_derivative(noise.model.alpha, s.d);
  if (std::abs(slope) < 1e-3) return weights;  // the range says nothing about the distance here
  const double spread = noise.model.noise.spread(s.d, evaluate_polynomial(noise.model.alpha, s.d)) / slope;
  weights.along = 1.0 / (stop.along(s.u) + spread * spread / s.R + 1e-18 * axis * axis);
  return weights;
}

/// Moves every used landmark; returns the largest move in standard deviations.
double sweep_landmarks(const JointProblem& problem, const std::vector<StopVariance>& stops,
                       const std::vector<RangeSample>& samples, const SweepNoise& noise, LandmarkMap& map) {
  const Cells& cells = problem.cells;
  std::vector<Matrix2d> A(map.position.size(), Matrix2d::Zero());
  std::vector<Vector2d> b(map.position.size(), Vector2d::Zero());
  for (const RangeSample& s : samples) {
    const int k = cells.stop[s.cell];
    const double phi = problem.stops[k].commanded.heading_rad + cells.bearing_mean[s.cell];
    const double axis = s.d + cells.radius_m[s.cell];
    const Vector2d across(std::sin(phi), -std::cos(phi));
    const Vector2d from =
        commanded_position(problem, k) - map.position[s.landmark];  // relative to the present position
    const CellWeights weights = sweep_weights(s, stops[k], across, axis, noise);
    A[s.landmark] += weights.across * across * across.transpose();
    b[s.landmark] += weights.across * across * across.dot(from);
    if (!(weights.along > 0.0)) continue;
    const double range = invert_near(noise.model.alpha, s.y, s.d) + cells.radius_m[s.cell];
    A[s.landmark] += weights.along * s.u * s.u.transpose();
    b[s.landmark] += weights.along * s.u * (s.u.dot(from) + range);
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

/// Squared extrapolation (Varadhan and Roland 2008, SQUAREM, scheme S3) over pairs of sweeps: with x0 -> x1
/// -> x2, r = x1 - x0, v = (x2 - x1) - r, a = -|r| / |v| held in [-16, -1], x = x0 - 2 a r + a^2 v; a = -1
/// gives x2. The sweeps converge linearly, slowly where bearings are poor; this leaves their fixed point
/// where it is.
class Extrapolation {
 public:
  /// Takes the positions after a sweep and moves them after every second one.
  void after_sweep(std::vector<Vector2d>& x) {
    history_.push_back(x);
    if (history_.size() < 3) return;
    double r_sq = 0.0, v_sq = 0.0;
    for (std::size_t l = 0; l < x.size(); ++l) {
      const Vector2d r = history_[1][l] - history_[0][l], v = history_[2][l] - history_[1][l] - r;
      r_sq += r.squaredNorm();
      v_sq += v.squaredNorm();
    }
    const double a = v_sq > 0.0 ? -std::clamp(std::sqrt(r_sq / v_sq), 1.0, 16.0) : -1.0;
    for (std::size_t l = 0; l < x.size(); ++l) {
      const Vector2d r = history_[1][l] - history_[0][l], v = history_[2][l] - history_[1][l] - r;
      x[l] = history_[0][l] - 2.0 * a * r + a * a * v;
    }
    history_ = {x};
  }
  void start(const std::vector<Vector2d>& x) { history_ = {x}; }

 private:
  std::vector<std::vector<Vector2d>> history_;
};

}  // namespace

namespace {

Calibration approximate_fit(const JointProblem& problem, const ClosedFormOptions& options,
                            const SolverLog& log) {
  Calibration result = begun_calibration(problem, Method::approximate);
  if (result.outcome == Outcome::too_few_data) return result;
  LandmarkMap map;
  double sigma_theta = 0.0;
  if (problem.reads_bearings) {
    const LandmarksFromBearings found = landmarks_from_bearings(problem, options.bearings);
    map = map_from(problem, found);
    for (std::size_t l = 0; l < map.used.size(); ++l) map.used[l] = found.landmarks[l].cells >= 2;
    sigma_theta = found.sigma_theta_rad;
  } else {
    map = map_from(landmarks_from_ranges(problem));
  }
  const std::vector<StopVariance> stops = stop_variances(problem, options.bearings.sigma_s_m);
  std::optional<int> order = options.order;
  RangeModel model;
  std::vector<RangeSample> samples;
  double move = 0.0;
  Extrapolation extrapolation;
  extrapolation.start(map.position);
  result.outcome = Outcome::not_converged;
  for (result.iterations = 0; result.iterations < options.max_sweeps;) {
    samples = samples_at(problem, map, stops);
    model = fit_range_model(samples, RangeWeighting::d_squared, map.covariance, order, options);
    if (!is_usable(model.outcome) || !model.f_positive) break;
    order = static_cast<int>(model.alpha.size()) - 1;  // chosen once, then kept
    if (problem.reads_bearings && !options.bearings.sigma_theta_rad) {
      if (const auto estimate = sigma_theta_at(problem, map, stops)) sigma_theta = estimate->value;
    }
    ++result.iterations;
    move = sweep_landmarks(problem, stops, samples,
                           {sigma_theta * sigma_theta, model, problem.reads_bearings}, map);
    log.iteration(result.iterations, not_known, move, not_known);
    if (!std::isfinite(move)) break;
    if (move < options.sweep_tolerance) {
      result.outcome = Outcome::converged;
      break;
    }
    extrapolation.after_sweep(map.position);
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
  fill_sigma_theta(problem, map, stops, options, result);
  if (is_usable(model.outcome) && model.f_positive) {
    std::vector<CellWeights> weights;
    for (const RangeSample& s : samples)
      weights.push_back(sweep_weights(s, stops[s.stop], {s.u.y(), -s.u.x()},
                                      s.d + problem.cells.radius_m[s.cell],
                                      {sigma_theta * sigma_theta, model, problem.reads_bearings}));
    model.alpha_covariance =
        curve_covariance(problem, samples, weights, model, sigma_theta, options.bearings.sigma_s_m);
  }
  fill_calibration(problem, map, model, samples, result);
  if (is_usable(model.outcome) && !model.f_positive) result.outcome = Outcome::failed;
  if (result.outcome == Outcome::not_converged)
    append_reason(result.reason, "landmarks still move by " + std::to_string(move) +
                                     " standard deviations after " + std::to_string(result.iterations) +
                                     " sweeps");
  return result;
}

}  // namespace

Calibration approximate_joint_calibration(const JointProblem& problem, const ClosedFormOptions& options) {
  SolverLog log("approximate");
  if (log.on() && options.order) log.of(curve_in_words(*options.order + 1, options.noise_law));
  Calibration result = approximate_fit(problem, options, log);
  log.end(result.iterations, not_known, not_known, result.outcome, result.reason);
  return result;
}

}  // namespace rangecal
