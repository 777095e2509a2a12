// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/known_distances.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "joint_ml/newton_step.hpp"
#include "pairs_ml/pairs_reml.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {
namespace {

/// The cells as the 2016 problem, whose first is the nearest and whose last the farthest: the two set its scale.
PairsProblem pairs_of(const JointProblem& problem, const JointState& state) {
  const Cells& c = problem.cells;
  const std::size_t size = c.size();
  PairsProblem pairs;
  pairs.true_m.resize(size);
  for (std::size_t i = 0; i < size; ++i)
    pairs.true_m[i] =
        state.landmarks[static_cast<std::size_t>(c.landmark[i])].x() - problem.stops[c.stop[i]].commanded.x_m;
  pairs.count = c.count;
  pairs.weight = c.range_weight;
  pairs.mean_m = c.range_mean;
  pairs.mean_square = c.range_mean_square;
  pairs.single = false;
  pairs.row_true_m.resize(static_cast<std::size_t>(problem.readings));  // their number alone is asked for
  const auto exchange = [&](std::size_t i, std::size_t j) {
    for (auto* column : {&pairs.true_m, &pairs.count, &pairs.weight, &pairs.mean_m, &pairs.mean_square})
      std::swap((*column)[i], (*column)[j]);
  };
  const auto index = [&](auto found) { return static_cast<std::size_t>(found - pairs.true_m.begin()); };
  exchange(0, index(std::min_element(pairs.true_m.begin(), pairs.true_m.end())));
  exchange(size - 1, index(std::max_element(pairs.true_m.begin(), pairs.true_m.end())));
  return pairs;
}

/// Second derivatives of the likelihood in the globals of the joint problem: alpha and log sigma; the landmark's
/// are left at zero, the bearings know sigma_theta alone.
Eigen::MatrixXd hessian_in_globals(const pairs_ml::ScaledPairs& scaled, const pairs_ml::NewtonResult& at,
                                   const JointLayout& layout, double readings) {
  Eigen::MatrixXd jacobian = scaled.jacobian(at.x);
  jacobian(jacobian.rows() - 1, jacobian.cols() - 1) = 1.0;  // log sigma is a global itself
  const Eigen::MatrixXd inverse = jacobian.inverse();
  const Eigen::MatrixXd own = inverse.transpose() * at.at.hessian * inverse;
  std::vector<int> places(static_cast<std::size_t>(own.rows()));
  std::iota(places.begin(), places.begin() + layout.alpha_count, 0);
  std::iota(places.begin() + layout.alpha_count, places.end(), layout.tau_begin);
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(layout.global_count, layout.global_count);
  hessian(places, places) = own;
  hessian(layout.sigma_theta, layout.sigma_theta) = 2.0 * readings;
  return hessian;
}

/// log sigma to where the residuals of the start put it: from far below Newton's steps of curve and sigma go astray.
void settle_sigma(const pairs_ml::ScaledPairs& scaled, pairs_ml::Vector& x) {
  pairs_ml::Evaluation at;
  scaled.evaluate(x, false, at);
  if (!at.valid) return;
  const Eigen::Index last = x.size() - 1;
  const double squares = 0.5 * at.hessian(last, last), readings = at.gradient[last] + squares;
  if (squares > 0.0 && readings > 0.0) x[last] += 0.5 * std::log(squares / readings);
}

/// The layout of the globals does not depend on the stops: that of one of them.
JointProblem of_one_stop(const JointProblem& problem) {
  JointProblem one;
  one.landmark_radius_m = problem.landmark_radius_m;
  one.landmark_recording = problem.landmark_recording;
  one.stops = {problem.stops.front()};
  one.stops.front().place = 0;
  one.place_count = 1;
  one.sigma_s_shared = {0};
  one.cells.stop_begin = {0, 0};
  return one;
}

}  // namespace

std::optional<MarginalFit> solve_at_known_distances(const JointProblem& problem, const JointState& start) {
  constexpr int max_iterations = 60;
  constexpr double full_tolerance = 1e-3;  // REML starts there
  const int order = static_cast<int>(start.alpha.size()) - 1;
  if (start.noise.law == NoiseLaw::polynomial || order + 2 > pairs_ml::max_unknowns ||
      problem.cells.size() == 0)
    return std::nullopt;
  const PairsProblem pairs = pairs_of(problem, start);
  const pairs_ml::ScaledPairs scaled(pairs, order, start.noise.law, 0, std::numeric_limits<int>::max());
  pairs_ml::Vector x = scaled.from_user(start.alpha, start.noise);
  if (!x.allFinite()) return std::nullopt;
  settle_sigma(scaled, x);
  pairs_ml::NewtonResult full =
      pairs_ml::minimise(scaled, x, scaled.unknowns(), max_iterations, full_tolerance);
  if (full.outcome != Outcome::converged) full.x = x;
  const pairs_ml::NewtonResult found = pairs_ml::restricted(scaled, full, max_iterations);
  if (found.outcome != Outcome::converged) return std::nullopt;
  MarginalFit fit;
  fit.state = start;
  fit.state.alpha = scaled.alpha(found.x);
  fit.state.noise = scaled.noise(found.x);
  fit.state.sigma_theta_rad = 1.0;
  for (std::size_t k = 0; k < problem.stops.size(); ++k) fit.state.stops[k] = problem.stops[k].commanded;
  fit.iterations = found.iterations;
  fit.outcome = Outcome::converged;
  // The bearings, all alike, at sigma_theta = 1 rad.
  fit.joint_nll = fit.marginal_nll = found.at.nll + problem.readings * (half_log_two_pi + 0.5);
  const JointProblem one = of_one_stop(problem);
  const JointLayout layout(one, order + 1, 1, false);
  Held held;
  held.landmarks = true;
  describe_covariance(hessian_in_globals(scaled, found, layout, problem.readings), layout,
                      free_globals(layout, held), fit);
  return fit;
}

}  // namespace rangecal::diagnosis
