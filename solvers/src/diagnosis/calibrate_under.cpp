// SPDX-License-Identifier: BSD-3-Clause
// The calibration refitted under a model whose parameters stand. Effects are evaluated at a state and taken out of the readings
// there; a solve of what is left, where those that change fast with distance go along as straight lines, proposes another state.
//
// Of landmarks the objective is that of the model itself,
//   l(state) = Laplace's NLL at the state of the working problem there      [nats],
// which nothing is linearised in: the way to the proposed state is shortened until it falls, with the slopes of REML in the spreads,
// which the solves follow. Of known distances, which move no effect, solves and effects alternate.
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "diagnosis/alternation.hpp"
#include "diagnosis/known_distances.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/stop_modes.hpp"
#include "marginal/laplace.hpp"
#include "rangecal/core/angles.hpp"
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

MarginalFit solve(const Rows& rows, const WorkingCells& working, const JointState& start,
                  const MarginalOptions& options) {
  const JointProblem& problem = working.problem;
  if (!working.serial.independent())
    return solve_with_serial_errors(problem, working.serial, start, options.held);
  if (rows.pairs && !options.held.alpha && !options.held.sigmas)
    if (std::optional<MarginalFit> fit = solve_at_known_distances(problem, start)) return std::move(*fit);
  return solve_marginal(problem, start, options);
}

/// A solve under the working problem, and of alpha under a simulation's prior, which is held at each solve, moves in between
/// while that gains. `value`: with that prior.
struct Solved {
  MarginalFit fit;
  double value = std::numeric_limits<double>::infinity();
  bool ok = false;
};

/// `with_rows`: the same with its rows; called once, under a simulation's prior.
template <typename WithRows>
Solved solve_with_alpha(const Rows& rows, const WorkingCells& working, const WithRows& with_rows,
                        const JointState& start, MarginalOptions& marginal) {
  Solved solved;
  solved.fit = solve(rows, working, start, marginal);
  if (!std::isfinite(solved.fit.marginal_nll) || solved.fit.outcome == Outcome::failed ||
      !holds_readings(rows, solved.fit.state))
    return solved;
  solved.ok = true;
  marginal.begin = solved.fit.reml;
  solved.value = solved.fit.marginal_nll + prior_nll(rows, solved.fit.state.alpha);
  if (!rows.alpha_prior || rows.alpha_prior->exact()) return solved;
  const WorkingProblem& full = with_rows();
  for (int move = 0; move < 3; ++move) {
    JointState moved = solved.fit.state;
    if (!(step_alpha(rows, full, moved) > 1e-3)) break;
    MarginalFit next = solve(rows, working, moved, marginal);
    const double next_value = next.marginal_nll + prior_nll(rows, next.state.alpha);
    if (next.outcome == Outcome::failed || !(next_value < solved.value)) break;
    solved.value = next_value;
    solved.fit = std::move(next);
  }
  return solved;
}

/// A state, the working problem there, and the objective l.
struct Point {
  JointState state;
  WorkingCells working;
  double value = std::numeric_limits<double>::infinity();
};

/// `sides`: those on which readings are taken to lie, at the cost of those that do not.
Point point_at(const Rows& rows, const Model& model, JointState state, const Sides* sides) {
  follow_commanded(commanded_under(rows, model), state.stops);
  Point point{std::move(state), {}};
  point.working = working_cells(rows, model, point.state, sides);
  double value = laplace_nll_at(point.working.problem, point.state) + point.working.constant +
                 prior_nll(rows, point.state.alpha);
  if (sides) {
    JointState restored = point.state;
    value += sides->restore(rows, restored);
  }
  if (!std::isnan(value)) point.value = value;
  return point;
}

/// `part` of the way from one state to another; spreads along their logarithms.
JointState between(const JointState& from, const JointState& to, double part) {
  JointState at = to;
  at.alpha = from.alpha + part * (to.alpha - from.alpha);
  if (has_sigma(to.noise.law))
    at.noise.parameters[0] =
        from.noise.parameters[0] * std::pow(to.noise.parameters[0] / from.noise.parameters[0], part);
  else
    at.noise.parameters = from.noise.parameters + part * (to.noise.parameters - from.noise.parameters);
  at.sigma_theta_rad = from.sigma_theta_rad * std::pow(to.sigma_theta_rad / from.sigma_theta_rad, part);
  for (std::size_t l = 0; l < at.landmarks.size(); ++l)
    at.landmarks[l] = from.landmarks[l] + part * (to.landmarks[l] - from.landmarks[l]);
  for (std::size_t k = 0; k < at.stops.size(); ++k) {
    at.stops[k].x_m = from.stops[k].x_m + part * (to.stops[k].x_m - from.stops[k].x_m);
    at.stops[k].y_m = from.stops[k].y_m + part * (to.stops[k].y_m - from.stops[k].y_m);
    at.stops[k].heading_rad =
        from.stops[k].heading_rad + part * wrap_angle(to.stops[k].heading_rad - from.stops[k].heading_rad);
  }
  return at;
}

/// What the slopes of REML add to the objective from one state to another.
double reml_between(const MarginalFit& fit, const JointState& from, const JointState& to) {
  return fit.reml ? fit.reml->slopes.dot(sigma_coordinates(to) - sigma_coordinates(from)) : 0.0;
}

/// Descent of l from a state.
class Descent {
 public:
  Descent(const Rows& rows, const Model& model, const RefitOptions& options, JointState start)
      : rows_(rows), model_(model), options_(options), jumps_(Sides::matter(model)) {
    if (jumps_) sides_.take(rows, model, start);
    here_ = point_at(rows, model, std::move(start), sides());
  }

  /// The least value that was reached; `state` moves there. Infinite where the first solve fails.
  double run(MarginalOptions& marginal, JointState& state, MarginalFit* detail) {
    if (!options_.places_stay) jump_to_modes();
    bool any = false;
    for (int iteration = 0; iteration < most; ++iteration) {
      std::optional<WorkingProblem> full;
      const auto with_rows = [&]() -> const WorkingProblem& {
        return full.emplace(working_problem(rows_, model_, here_.state, sides()));
      };
      Solved solved = solve_with_alpha(rows_, here_.working, with_rows, here_.state, marginal);
      if (!solved.ok && !any) return std::numeric_limits<double>::infinity();
      if (!solved.ok) break;
      const bool goes_on = step_towards(solved);
      if (detail) *detail = std::move(solved.fit);
      any = true;
      if (!goes_on) break;
    }
    state = std::move(here_.state);
    if (jumps_) sides_.restore(rows_, state);
    return here_.value;
  }

 private:
  static constexpr int most = 6;                        ///< solves
  static constexpr double settled = 5e-3;               ///< nats
  static constexpr double worth_shortening = 0.1;       ///< nats that a solve promises
  static constexpr double shorter = 0.3, least = 0.05;  ///< of the way

  const Sides* sides() const { return jumps_ ? &sides_ : nullptr; }

  /// Takes the places to the likeliest of the modes that effects which oscillate or jump leave them, where that gains.
  void jump_to_modes() {
    const bool oscillates = !here_.working.problem.cells.effect_slope.empty();
    JointState moved = here_.state;
    if (oscillates && move_places_to_modes(rows_, model_, here_.working, ModeSearch::all, moved)) {
      Sides sides;
      sides.take(rows_, model_, moved);
      take_if_better(std::move(moved), std::move(sides));
    }
    if (!jumps_) return;
    moved = here_.state;
    Sides sides;
    sides.settle(rows_, model_, moved);
    take_if_better(std::move(moved), std::move(sides));
  }

  void take_if_better(JointState moved, Sides sides) {
    Point there = point_at(rows_, model_, std::move(moved), jumps_ ? &sides : nullptr);
    if (!(there.value < here_.value)) return;
    here_ = std::move(there);
    sides_ = std::move(sides);
  }

  /// Moves towards what a solve proposes as far as the objective falls. True where another solve may gain.
  bool step_towards(const Solved& solved) {
    const double promised = solved.value + here_.working.constant;
    for (double part = 1.0; part > least; part *= shorter) {
      Point there = followed(between(here_.state, solved.fit.state, part));
      const double rise = there.value - here_.value + reml_between(solved.fit, here_.state, there.state);
      if (rise < 1e-6) {
        const bool as_promised = part == 1.0 && std::abs(there.value - promised) < settled;
        here_ = std::move(there);
        return -rise > settled && !as_promised;
      }
      if (here_.value - promised < worth_shortening) break;
    }
    return false;
  }

  /// The point at a state, its places in the optima of their own nearby where the solve's straight lines missed them.
  Point followed(JointState state) const {
    Point there = point_at(rows_, model_, std::move(state), sides());
    JointState moved = there.state;
    if (!follow_oscillation(rows_, model_, here_.working, here_.state, there.working, sides(), moved))
      return there;
    Point nearer = point_at(rows_, model_, std::move(moved), sides());
    return nearer.value < there.value ? nearer : there;
  }

  const Rows& rows_;
  const Model& model_;
  const RefitOptions& options_;
  bool jumps_;
  Sides sides_;
  Point here_;
};

/// Effects and solves in turn, of known distances, or of no effects.
double solve_in_turn(const Rows& rows, const Model& model, JointState& state, MarginalOptions& marginal,
                     MarginalFit* detail) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  double value = infinity, least = infinity;
  JointState least_state = state;
  bool along_sequence = false;
  Alternation alternation(model);
  do {
    const WorkingProblem working = alternation.begin(rows, model, state);
    // Tails along a sequence have weights of where the solve began, which no bound goes with: the value is that of the model where it
    // ended.
    along_sequence = !working.serial.independent() && working.tail_shift.size() > 0;
    if (along_sequence && least == infinity) {
      least = nll_at(rows, working, state) + prior_nll(rows, state.alpha);
      least_state = state;
    }
    JointState start = state;
    follow_commanded(working.problem.stops, start.stops);
    const auto with_rows = [&]() -> const WorkingProblem& { return working; };
    Solved solved = solve_with_alpha(rows, working, with_rows, start, marginal);
    if (!solved.ok) return infinity;
    state = solved.fit.state;
    value = solved.value + working.constant;
    if (along_sequence) {
      value = nll_at(rows, working_problem(rows, model, state), state) + prior_nll(rows, state.alpha);
      if (detail) *detail = solved.fit;
      if (!(value < least)) continue;
    }
    least = value;
    least_state = state;
    if (detail) *detail = std::move(solved.fit);
  } while (alternation.another(rows, state, value));
  if (!along_sequence) return value;
  state = std::move(least_state);
  return least;
}

}  // namespace

double calibrate_under(const Rows& rows, const Model& model, JointState& state, const RefitOptions& options,
                       MarginalFit* detail) {
  MarginalOptions marginal;
  marginal.held = options.held;
  marginal.held.alpha = marginal.held.alpha || rows.alpha_prior.has_value();
  marginal.held.landmarks = marginal.held.landmarks || rows.pairs;
  marginal.gradient_tolerance = options.gradient_tolerance;
  if (detail) marginal.begin = detail->reml;
  if (rows.pairs || model.empty()) return solve_in_turn(rows, model, state, marginal, detail);
  return Descent(rows, model, options, state).run(marginal, state, detail);
}

}  // namespace rangecal::diagnosis
