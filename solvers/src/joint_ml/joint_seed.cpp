// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/QR>
#include <algorithm>
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "joint_ml/seed_from.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {
namespace {

/// A stop stands inside a landmark that it sees: no distance, so no likelihood.
bool stands_inside(const JointProblem& problem, const JointState& state) {
  const Cells& c = problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i)
    if (!(Sight(state.landmarks[c.landmark[i]], state.stops[c.stop[i]], c.radius_m[i]).d > 0.0)) return true;
  return false;
}

/// Stops and landmarks of the joint maximum of the same readings taken to the axes: y + radius on landmarks of radius 0,
/// a line for f. There every distance is positive, wherever odometry that has drifted puts a stop.
void relax_on_axes(const JointProblem& problem, JointState& state) {
  JointProblem axes = problem;
  for (std::size_t i = 0; i < axes.cells.size(); ++i) axes.cells.range_mean[i] += axes.cells.radius_m[i];
  std::fill(axes.cells.radius_m.begin(), axes.cells.radius_m.end(), 0.0);
  std::fill(axes.landmark_radius_m.begin(), axes.landmark_radius_m.end(), 0.0);
  axes.estimate_sigma_s = false;
  JointState start = state;
  start.noise.law = NoiseLaw::constant;
  seed_curve_and_noise(axes, 1, start);
  const JointFit fit = solve_joint_block(axes, start);
  if (!std::isfinite(fit.joint_nll) || !(fit.joint_nll <= fit.start_nll)) return;
  state.stops = fit.state.stops;
  state.landmarks = fit.state.landmarks;
}

}  // namespace

void seed_curve_and_noise(const JointProblem& problem, int order, JointState& state) {
  const Cells& c = problem.cells;
  const Eigen::Index cells = static_cast<Eigen::Index>(c.size());
  if (cells < order + 1) throw InputError("fewer cells than coefficients of the curve");
  Eigen::VectorXd distance(cells), turn(cells);
  Eigen::MatrixXd rows(cells, order + 1);
  Eigen::VectorXd target(cells);
  // Weights are floored so that one very near landmark does not decide alone; 0.2 m and 1 mm where readings are of 2.5 m.
  const double scale = mean_range(problem), near = 0.08 * scale, nearest = 4e-4 * scale;
  for (Eigen::Index i = 0; i < cells; ++i) {
    const Sight sight(state.landmarks[c.landmark[i]], state.stops[c.stop[i]], c.radius_m[i]);
    distance[i] = std::max(sight.d, nearest);
    turn[i] = wrap_angle(c.bearing_mean[i] - sight.bearing);
    const double weight =
        std::sqrt(c.count[i]) / std::max(distance[i] * distance[i], near * near);  // R / d^4 (2016 eq. 21)
    double power = weight;
    for (int a = 0; a <= order; ++a, power *= distance[i]) rows(i, a) = power;
    target[i] = weight * c.range_mean[i];
  }
  state.alpha = rows.colPivHouseholderQr().solve(target);

  double range_sum = 0.0, turn_sum = 0.0;
  Noise unit = state.noise;
  if (unit.law ==
      NoiseLaw::polynomial) {  // beta = sigma (1, 0, (d / scale)^2) to begin with, positive everywhere
    unit.parameters = Eigen::VectorXd::Zero(std::max<Eigen::Index>(order + 1, state.noise.parameters.size()));
    unit.parameters[0] = 0.3;
    unit.parameters[unit.parameters.size() - 1] = 0.3 * std::pow(scale, 1 - unit.parameters.size());
  } else {
    unit.parameters = Eigen::VectorXd::Ones(1);
  }
  for (Eigen::Index i = 0; i < cells; ++i) {
    const double f = evaluate_polynomial(state.alpha, distance[i]);
    const double s = unit.spread(distance[i], std::max(f, nearest));
    const double error = c.range_mean[i] - f;
    range_sum += c.range_weight[i] * (error * error + c.range_mean_square[i]) / (s * s);
    turn_sum += c.bearing_weight[i] * (turn[i] * turn[i] + c.bearing_mean_square[i]);
  }
  state.noise.law = unit.law;
  const double least = 1e-9 * scale / unit.spread(scale, scale);
  state.noise.parameters = std::max(std::sqrt(range_sum / problem.readings), least) * unit.parameters;
  state.sigma_theta_rad = std::max(std::sqrt(turn_sum / problem.readings), 1e-9);
}

JointState position_seed(const JointProblem& problem, int order, NoiseLaw law) {
  JointState state;
  state.noise.law = law;
  for (const StopPrior& prior : problem.stops) state.stops.push_back(prior.commanded);
  state.landmarks.assign(problem.landmark_count(), Eigen::Vector2d::Zero());
  std::vector<double> weight(problem.landmark_count(), 0.0);
  const Cells& c = problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const Pose2& pose = state.stops[c.stop[i]];
    const double reach = c.range_mean[i] + c.radius_m[i], direction = pose.heading_rad + c.bearing_mean[i];
    const double w = c.count[i] / (reach * reach);
    state.landmarks[c.landmark[i]] +=
        w * Eigen::Vector2d(pose.x_m + reach * std::cos(direction), pose.y_m + reach * std::sin(direction));
    weight[c.landmark[i]] += w;
  }
  for (std::size_t l = 0; l < weight.size(); ++l)
    if (weight[l] > 0.0) state.landmarks[l] /= weight[l];
  seed_from_places(problem, order, state);
  return state;
}

void seed_from_places(const JointProblem& problem, int order, JointState& state) {
  if (stands_inside(problem, state)) relax_on_axes(problem, state);
  seed_curve_and_noise(problem, order, state);
}

}  // namespace rangecal
