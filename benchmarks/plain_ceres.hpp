// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/autodiff_cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal::benchmark {

/// What a user of Ceres writes for the same model without more ado: automatic derivatives, one residual block per
/// reading, SPARSE_NORMAL_CHOLESKY. The log-determinant is the residual sqrt(2 log(s / s_floor)) per reading. Model:
/// order 2, exact headings, independent stops, a power law in f, one cell per reading; radius known.
///
/// floor_ratio: s_floor over the reading's spread at the start. A small one lets a single solve go anywhere; one near
/// e^(-1/2) makes Gauss-Newton's matrix the Fisher information at the start, and fails where a spread falls below it.
struct PlainOptions {
  double floor_ratio = 0.1;
  double function_tolerance = 1e-10;
  int max_iterations = 400;
};

struct PlainRange {
  double y, radius, log_floor;
  int power;
  template <typename T>
  bool operator()(const T* alpha, const T* log_sigma, const T* stop, const T* landmark, T* r) const {
    using std::log, std::sqrt, std::exp;
    const T dx = landmark[0] - stop[0], dy = landmark[1] - stop[1];
    const T d = sqrt(dx * dx + dy * dy) - radius;
    const T f = alpha[0] + d * (alpha[1] + d * alpha[2]);
    if (!(f > T(0.0))) return false;
    const T log_s = log_sigma[0] + T(double(power)) * log(f);
    if (!(log_s > T(log_floor))) return false;
    r[0] = (y - f) * exp(-log_s);
    r[1] = sqrt(2.0 * (log_s - log_floor));
    return true;
  }
};

struct PlainBearing {
  double bearing, log_floor;
  template <typename T>
  bool operator()(const T* log_sigma, const T* stop, const T* landmark, T* r) const {
    using std::atan2, std::sqrt, std::exp;
    T turn = bearing - atan2(landmark[1] - stop[1], landmark[0] - stop[0]);
    if (turn > T(std::numbers::pi)) turn -= 2.0 * std::numbers::pi;
    if (turn < T(-std::numbers::pi)) turn += 2.0 * std::numbers::pi;
    if (!(log_sigma[0] > T(log_floor))) return false;
    r[0] = turn * exp(-log_sigma[0]);
    r[1] = sqrt(2.0 * (log_sigma[0] - log_floor));
    return true;
  }
};

struct PlainPrior {
  double x, y, sigma;
  template <typename T>
  bool operator()(const T* stop, T* r) const {
    r[0] = (stop[0] - x) / sigma;
    r[1] = (stop[1] - y) / sigma;
    return true;
  }
};

inline JointState solve_plain_ceres(const JointProblem& problem, const JointState& start,
                                    const PlainOptions& plain, int* iterations = nullptr) {
  JointState state = start;
  const Cells& c = problem.cells;
  double log_sigma = std::log(start.noise.parameters[0]), log_sigma_theta = std::log(start.sigma_theta_rad);
  std::vector<double> stops, landmarks;
  for (const Pose2& p : start.stops) stops.insert(stops.end(), {p.x_m, p.y_m});
  for (const Eigen::Vector2d& m : start.landmarks) landmarks.insert(landmarks.end(), {m.x(), m.y()});
  const double drop = std::log(plain.floor_ratio);
  ceres::Problem program;
  for (std::size_t i = 0; i < c.size(); ++i) {
    double *stop = &stops[2 * c.stop[i]], *landmark = &landmarks[2 * c.landmark[i]];
    const double d = std::hypot(landmark[0] - stop[0], landmark[1] - stop[1]) - c.radius_m[i];
    const double f = start.alpha[0] + d * (start.alpha[1] + d * start.alpha[2]);
    program.AddResidualBlock(new ceres::AutoDiffCostFunction<PlainRange, 2, 3, 1, 2, 2>(new PlainRange{
                                 c.range_mean[i], c.radius_m[i], std::log(start.noise.spread(d, f)) + drop,
                                 start.noise.power_of_f()}),
                             nullptr, state.alpha.data(), &log_sigma, stop, landmark);
    program.AddResidualBlock(new ceres::AutoDiffCostFunction<PlainBearing, 2, 1, 2, 2>(
                                 new PlainBearing{c.bearing_mean[i], std::log(start.sigma_theta_rad) + drop}),
                             nullptr, &log_sigma_theta, stop, landmark);
  }
  for (std::size_t k = 0; k < problem.stops.size(); ++k)
    program.AddResidualBlock(
        new ceres::AutoDiffCostFunction<PlainPrior, 2, 2>(new PlainPrior{
            problem.stops[k].commanded.x_m, problem.stops[k].commanded.y_m, problem.stops[k].sigma_xy_m}),
        nullptr, &stops[2 * k]);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  options.max_num_iterations = plain.max_iterations;
  options.max_num_consecutive_invalid_steps = 50;
  options.function_tolerance = plain.function_tolerance;
  options.gradient_tolerance = 0.0;
  options.parameter_tolerance = 0.0;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &program, &summary);
  if (iterations) *iterations = static_cast<int>(summary.iterations.size());
  state.noise.parameters[0] = std::exp(log_sigma);
  state.sigma_theta_rad = std::exp(log_sigma_theta);
  for (std::size_t k = 0; k < state.stops.size(); ++k) {
    state.stops[k].x_m = stops[2 * k];
    state.stops[k].y_m = stops[2 * k + 1];
  }
  for (std::size_t l = 0; l < state.landmarks.size(); ++l)
    state.landmarks[l] = {landmarks[2 * l], landmarks[2 * l + 1]};
  return state;
}

}  // namespace rangecal::benchmark
