// SPDX-License-Identifier: BSD-3-Clause
// The calibration refitted under a model whose parameters stand.
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "diagnosis/alternation.hpp"
#include "diagnosis/known_distances.hpp"
#include "diagnosis/refit.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

/// Coordinates that are not free follow the model's commanded poses: exact ones, and those of stops that
/// share the position error of the stop that opened their place.
void follow_commanded(const std::vector<StopPrior>& priors, std::vector<Pose2>& stops) {
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const StopPrior& prior = priors[k];
    if (prior.sigma_heading_rad == 0.0) stops[k].heading_rad = prior.commanded.heading_rad;
    if (!prior.opens_place || prior.sigma_xy_m > 0.0) continue;
    stops[k].x_m = prior.commanded.x_m;
    stops[k].y_m = prior.commanded.y_m;
  }
  share_places(priors, stops);
}

double prior_nll(const Rows& rows, const Eigen::VectorXd& alpha) {
  if (!rows.alpha_prior || rows.alpha_prior->exact()) return 0.0;
  const Eigen::VectorXd off = alpha - rows.alpha_prior->mean;
  return 0.5 * off.dot(rows.alpha_prior->precision * off);
}

/// Moves alpha by a Gauss-Newton step towards its optimum under the prior; returns the gain that it predicts [nats].
double step_alpha(const Rows& rows, const WorkingProblem& working, JointState& state) {
  const Projector projector(rows, working, state);
  const Eigen::Index alphas = state.alpha.size();
  const AlphaPrior& prior = *rows.alpha_prior;
  const Eigen::VectorXd gradient = projector.alpha_gradient() + prior.precision * (state.alpha - prior.mean);
  const Eigen::VectorXd step = -projector.phi_covariance().topLeftCorner(alphas, alphas) * gradient;
  state.alpha += step;
  return -0.5 * gradient.dot(step);
}

/// True if half of the cells have spreads below the farthest reading: beyond that a likelihood has lost the readings, as that
/// of a curve that falls to 0 may, whose spread does so too.
bool holds_readings(const Rows& rows, const JointState& state) {
  return upper_median(cell_geometry(rows, state).spread) < rows.context.range_max_m;  // false of NaN
}

MarginalFit solve(const Rows& rows, const WorkingProblem& working, const JointState& start,
                  const MarginalOptions& options) {
  const JointProblem& problem = working.problem;
  if (!working.serial.independent())
    return solve_with_serial_errors(problem, working.serial, start, options.held);
  if (rows.pairs && !options.held.alpha && !options.held.sigmas)
    if (std::optional<MarginalFit> fit = solve_at_known_distances(problem, start)) return std::move(*fit);
  return solve_marginal(problem, start, options);
}

}  // namespace

double calibrate_under(const Rows& rows, const Model& model, JointState& state, const RefitOptions& options,
                       MarginalFit* detail) {
  MarginalOptions marginal;
  marginal.held = options.held;
  marginal.held.alpha = marginal.held.alpha || rows.alpha_prior.has_value();
  marginal.held.landmarks = marginal.held.landmarks || rows.pairs;
  marginal.gradient_tolerance = 1e-4;
  constexpr double infinity = std::numeric_limits<double>::infinity();
  double value = infinity, least = infinity;
  JointState least_state = state;
  bool at_the_end = false;
  Alternation alternation(model, options.places_stay);
  if (detail) marginal.begin = detail->reml;
  do {
    const WorkingProblem working = alternation.begin(rows, model, state);
    const bool weighted = !working.serial.independent() && working.tail_shift.size() > 0;
    if (weighted && least == infinity) {
      least = nll_at(rows, working, state) + prior_nll(rows, state.alpha);
      least_state = state;
    }
    JointState start = state;
    follow_commanded(working.problem.stops, start.stops);
    MarginalFit fit = solve(rows, working, start, marginal);
    if (!std::isfinite(fit.marginal_nll) || fit.outcome == Outcome::failed ||
        !holds_readings(rows, fit.state))
      return infinity;
    marginal.begin = fit.reml;
    // Alpha under a simulation's prior: held at each solve, moved in between while that gains.
    double fit_value = fit.marginal_nll + prior_nll(rows, fit.state.alpha);
    for (int move = 0; move < 3 && rows.alpha_prior && !rows.alpha_prior->exact(); ++move) {
      JointState moved = fit.state;
      if (!(step_alpha(rows, working, moved) > 1e-3)) break;
      MarginalFit next = solve(rows, working, moved, marginal);
      const double next_value = next.marginal_nll + prior_nll(rows, next.state.alpha);
      if (next.outcome == Outcome::failed || !(next_value < fit_value)) break;
      fit_value = next_value;
      fit = std::move(next);
    }
    state = fit.state;
    value = fit_value + working.constant;
    // The solve saw straight lines, or tails along a sequence by the weights where it began, which no bound goes with: the value
    // is that of the model where it ended.
    if (alternation.has_effect_slope()) {
      const WorkingProblem ended = working_problem(rows, model, state);
      value += nll_at(rows, ended, state) - nll_at(rows, working, state);
    } else if (weighted) {
      value = nll_at(rows, working_problem(rows, model, state), state) + prior_nll(rows, state.alpha);
      if (detail) *detail = fit;
    }
    at_the_end = alternation.has_effect_slope() || weighted;
    if (at_the_end && !(value < least)) continue;
    least = value;
    least_state = state;
    if (detail) *detail = std::move(fit);
  } while (alternation.another(rows, model, state, value));
  if (!at_the_end) return value;
  state = std::move(least_state);
  return least;
}

}  // namespace rangecal::diagnosis
