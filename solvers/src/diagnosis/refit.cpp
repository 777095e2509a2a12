// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/refit.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "diagnosis/alternation.hpp"
#include "diagnosis/free_parameters.hpp"
#include "diagnosis/joint_scoring.hpp"
#include "diagnosis/likeliest_sequence.hpp"
#include "diagnosis/refit_step.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "diagnosis/tail_slopes.hpp"
#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

/// Moves every parameter but those of line searches by `damping` of the step, within its bounds.
void move_parameters(const Rows& rows, const std::vector<FreeParameter>& free, const Eigen::VectorXd& step,
                     double damping, Model& model) {
  for (std::size_t a = 0; a < free.size(); ++a) {
    if (free[a].acts == FreeParameter::Acts::numeric) continue;
    const EffectParameter& info = info_of(model, free[a]);
    const auto [low, high] = bounds_of(rows, model, free[a]);
    // A non-linear parameter moves by at most a third of its bounds at a time.
    const double limit = info.linear ? std::numeric_limits<double>::infinity() : 0.33 * (high - low);
    double& value = value_of(model, free[a]);
    value = std::clamp(value + std::clamp(damping * step[static_cast<Eigen::Index>(a)], -limit, limit), low,
                       high);
  }
}

/// Fits the parameters that only the value of the likelihood knows: scoring of the tails', those of a sequence by its residuals,
/// line searches of the others; true if there are any. Where there are several they depend on one another.
bool search_lines(const Rows& rows, const RefitOptions& options, Fit& fit) {
  std::vector<FreeParameter> lines;
  bool tails = false, sequence = false;
  for (const FreeParameter& p : fit.free)
    if (is_of_tail(fit.model, p))
      tails = true;
    else if (is_of_sequence(rows, fit.model, p))
      sequence = true;
    else if (p.acts == FreeParameter::Acts::numeric)
      lines.push_back(p);
  const std::size_t kinds = lines.size() + (tails ? 1 : 0) + (sequence ? 1 : 0);
  for (int sweep = 0; sweep < (kinds > 1 ? 2 : 1); ++sweep) {
    if (tails) fit_tails(rows, options, fit);
    if (sequence) fit_sequence(rows, options, fit);
    for (const FreeParameter& p : lines) search_line(rows, p, options, sweep == 0 ? 2.0 : 1.2, fit);
  }
  return kinds > 0;
}

/// Where the calibration is expected under the parameters of `to`: it takes up what the means lose by them.
JointState follow_parameters(const Rows& rows, const Projector& projector, const Fit& fit,
                             const ParameterStep& step, const Model& to) {
  if (rows.pairs) return fit.state;
  Signature lost;  // by the means
  lost.range.setZero(projector.cells());
  lost.bearing.setZero(projector.cells());
  for (std::size_t a = 0; a < fit.free.size(); ++a) {
    const FreeParameter& p = fit.free[a];
    if (p.acts == FreeParameter::Acts::mean)
      lost.take_out(to[p.effect].parameters[p.index] - fit.model[p.effect].parameters[p.index],
                    step.signatures[a]);
  }
  const JointSystem& system = projector.system();
  Eigen::VectorXd globals = Eigen::VectorXd::Zero(system.layout().global_count), phi, stops;
  projector.absorbed(lost, phi, stops);
  globals.head(phi.size()) = phi;
  JointState state = step_state(system.problem(), system.layout(), fit.state, globals, stops);
  const std::vector<StopPrior> before = commanded_under(rows, fit.model), after = commanded_under(rows, to);
  for (std::size_t k = 0; k < state.stops.size(); ++k) {
    const Pose2 &from = before[k].commanded, &there = after[k].commanded;
    state.stops[k].x_m += there.x_m - from.x_m;
    state.stops[k].y_m += there.y_m - from.y_m;
    state.stops[k].heading_rad += there.heading_rad - from.heading_rad;
  }
  return state;
}

/// A length of a step, as a part of it, and by how much the value rose there [nats].
struct TriedLength {
  double length = 0.0, rise = 0.0;
  bool by_values = false;  ///< of those tried before, whose parabola is least there
};

/// Where a parabola through a rise of 0 at length 0 and two others is least, no farther than the shorter one to either side; 0
/// where it has no least value.
double vertex_of(const TriedLength& longer, const TriedLength& shorter) {
  const double a = shorter.length, b = longer.length;
  const double curvature = (longer.rise / b - shorter.rise / a) / (b - a),
               slope = shorter.rise / a - curvature * a;
  return curvature > 0.0 ? std::clamp(-0.5 * slope / curvature, -a, a) : 0.0;
}

/// What is tried after lengths that did not gain: a shorter one; then, for the predicted slope knows no log-determinant and may
/// point the wrong way, where the values say that it is least; of length 0 where nothing is left.
TriedLength next_length(const std::vector<TriedLength>& tried) {
  constexpr std::size_t most = 5;
  constexpr double shorter = 0.4;
  const TriedLength& last = tried.back();
  if (last.by_values || tried.size() == most) return {};
  if (tried.size() == 1 || !std::isfinite(tried[tried.size() - 2].rise)) return {shorter * last.length};
  return {vertex_of(tried[tried.size() - 2], last), 0.0, true};
}

/// Takes the places of a fit that kept them to the modes that are likeliest now; false where that gains next to nothing.
bool gains_by_jumps(const Rows& rows, const RefitOptions& options, Fit& fit, MarginalFit& detail) {
  constexpr double next_to_nothing = 1e-3;  // nats
  JointState state = fit.state;
  MarginalFit there;
  there.reml = detail.reml;
  const double before = fit.nll, value = calibrate_under(rows, fit.model, state, options, &there);
  if (!(value < before)) return false;
  fit.state = std::move(state);
  fit.nll = value;
  detail = std::move(there);
  return before - value > next_to_nothing;
}

/// Damped Gauss-Newton steps of all others. Places may jump to other modes in the first steps and once these have ended, and keep them
/// in between, where they are looked for in vain and cost most. True if the fit moved, and `detail` is of where it ended.
bool step_parameters(const Rows& rows, const RefitOptions& options, Fit& fit, MarginalFit& detail,
                     const SolverLog& log) {
  constexpr double next_to_nothing = 5e-3;  // nats: a shorter step is not worth a solve
  constexpr double worth_another = 0.02;    // nats, of a step that only a third length gained
  constexpr double shortest = 0.15;         // of the first length tried
  constexpr int steps_with_jumps = 2;
  bool moved = false;
  double damping = 1.0;
  RefitOptions stepping = options;
  int steps = 0;  // since places could jump
  const auto ends = [&] {
    if (stepping.places_stay == options.places_stay || !gains_by_jumps(rows, options, fit, detail))
      return true;
    stepping.places_stay = options.places_stay;
    steps = 0;
    damping = 1.0;
    return false;
  };
  for (int iteration = 0; iteration < options.max_iterations && !fit.free.empty(); ++iteration) {
    const WorkingProblem working = working_problem(rows, fit.model, fit.state);
    const Projector projector(rows, working, fit.state);
    const std::optional<ParameterStep> step =
        newton_parameters(rows, working, projector, fit.model, fit.free);
    if (!step) break;
    fit.covariance = step->covariance;
    const double predicted_gain = step->predicted_gain;
    const double gradient_norm = std::sqrt(2.0 * std::max(0.0, predicted_gain));
    if (predicted_gain < 1e-3) {
      log.iteration(iteration + 1, fit.nll, 0.0, gradient_norm, {"length", damping});
      if (ends()) break;
      continue;
    }
    const bool has_modes = Sides::matter(fit.model) || !working.problem.cells.effect_slope.empty();
    if (has_modes && steps++ >= steps_with_jumps) stepping.places_stay = true;
    bool accepted = false;
    std::vector<TriedLength> tried;
    for (TriedLength next{damping}; tried.empty() || std::abs(next.length) * predicted_gain > next_to_nothing;
         next = next_length(tried)) {
      const double length = next.length;
      Model trial = fit.model;
      move_parameters(rows, fit.free, step->parameters, length, trial);
      JointState state = follow_parameters(rows, projector, fit, *step, trial);
      MarginalFit trial_detail;
      trial_detail.reml = detail.reml;
      const double value = calibrate_under(rows, trial, state, stepping, &trial_detail);
      if (value < fit.nll + 1e-7) {
        accepted = fit.nll - value > (tried.size() < 2 ? 1e-3 : worth_another);
        fit.model = trial;
        fit.state = state;
        fit.nll = value;
        detail = trial_detail;
        moved = true;
        log.iteration(iteration + 1, fit.nll, length * gradient_norm, gradient_norm, {"length", length});
        damping = std::clamp(2.5 * length, shortest, 1.0);
        break;
      }
      next.rise = value - fit.nll;
      tried.push_back(next);
    }
    if (!accepted) {
      log.iteration(iteration + 1, fit.nll, 0.0, gradient_norm, {"length", damping});
      if (ends()) break;
    }
  }
  return moved;
}

/// Of the parameters that move means and variances, where the fit ended.
void set_covariance(const Rows& rows, Fit& fit) {
  if (fit.free.empty()) return;
  const WorkingProblem working = working_problem(rows, fit.model, fit.state);
  const Projector projector(rows, working, fit.state);
  if (const auto step = newton_parameters(rows, working, projector, fit.model, fit.free))
    fit.covariance = step->covariance;
}

/// Of alpha and the sigmas.
void set_calibration_spread(const Rows& rows, const MarginalFit& detail, Fit& fit) {
  const int alphas = static_cast<int>(fit.state.alpha.size());
  if (detail.covariance) {
    fit.alpha_covariance = detail.covariance->topLeftCorner(alphas, alphas);
    const JointLayout layout(rows.problem, alphas, static_cast<int>(fit.state.noise.parameters.size()),
                             false);
    const int coordinates = 2 * rows.problem.landmark_count();
    if (!rows.pairs)
      fit.landmark_covariance =
          detail.covariance->block(layout.landmark_begin, layout.landmark_begin, coordinates, coordinates);
    const int tau =
        static_cast<int>(detail.covariance->rows()) - 1 - static_cast<int>(fit.state.noise.parameters.size());
    fit.noise_std = std::sqrt((*detail.covariance)(tau, tau));
    fit.sigma_theta_std = fit.state.sigma_theta_rad * std::sqrt(detail.covariance->diagonal().tail(1)[0]);
  }
  if (rows.alpha_prior) {
    fit.alpha_covariance = Eigen::MatrixXd::Zero(alphas, alphas);
    const WorkingProblem working = working_problem(rows, fit.model, fit.state);
    if (!rows.alpha_prior->exact())
      fit.alpha_covariance =
          Projector(rows, working, fit.state).phi_covariance().topLeftCorner(alphas, alphas);
  }
}

Fit fit_beside(const Rows& rows, const Model& start_model, const JointState& start,
               const RefitOptions& options, const SolverLog& log) {
  Fit fit;
  fit.model = start_model;
  fit.state = start;
  {
    const WorkingProblem working = working_problem(rows, {}, start);
    const Projector projector(rows, working, start);
    fit.free = free_parameters(rows, projector, start_model, options.settled);
  }
  MarginalFit detail;
  const bool scored =
      is_scored_jointly(rows, fit.model, fit.state, options) && score_jointly(rows, options, fit, detail);
  if (!scored) fit.nll = calibrate_under(rows, fit.model, fit.state, options, &detail);
  if (!std::isfinite(fit.nll)) return fit;
  const Eigen::Index n = static_cast<Eigen::Index>(fit.free.size());
  fit.covariance = Eigen::MatrixXd::Zero(n, n);
  if (scored) {
    set_covariance(rows, fit);
  } else {
    const bool searched = search_lines(rows, options, fit);  // first: they set the scale of everything else
    const bool stepped = step_parameters(rows, options, fit, detail, log);
    if (searched && !stepped) {  // since `detail` was told
      JointState state = fit.state;
      calibrate_under(rows, fit.model, state, options, &detail);
    }
  }
  fit.outcome = detail.outcome;
  fit.reason = detail.reason;
  fit.covariance_reason = detail.covariance_reason;
  fit.weakest_direction = detail.weakest_direction;
  set_calibration_spread(rows, detail, fit);
  fit.ok = std::all_of(fit.model.begin(), fit.model.end(),
                       [](const ActiveEffect& active) { return active.parameters.allFinite(); });
  return fit;
}

}  // namespace

RefitOptions as_they_are(const Fit& fit, RefitOptions options) {
  options.settled = static_cast<int>(fit.model.size());
  options.learned = fit.learned;
  return options;
}

RefitOptions roughly(const Fit& fit, const RefitOptions& options) {
  RefitOptions rough = as_they_are(fit, options);
  rough.max_iterations = 2;
  return rough;
}

Fit refit(const Rows& rows, const Model& start_model, const JointState& start, const RefitOptions& options) {
  SolverLog log("refit");
  if (log.on()) log.of(set_in_words(member_names(start_model, 0)));
  Fit fit = fit_beside(rows, start_model, start, options, log);
  log.end(-1, fit.nll, not_known, fit.outcome, fit.reason);
  return fit;
}

JointState start_beside(const Rows& rows, const Fit& fit, const Model& model) {
  JointState start = fit.state;
  if (!is_scored_jointly(rows, model, start, {})) return start;
  const CellGeometry geometry = cell_geometry(rows, fit.state);
  const Eigen::VectorXd lacking =
      row_changes(rows, geometry, fit.model).range - row_changes(rows, geometry, model).range;
  if (lacking.isZero(0.0)) return start;
  const Projector projector(rows, working_problem(rows, fit.model, fit.state), fit.state);
  Eigen::VectorXd phi, stops;
  projector.absorbed(projector.of_rows(lacking, Eigen::VectorXd::Zero(lacking.size())), phi, stops);
  const Eigen::VectorXd moved = start.alpha + phi.head(start.alpha.size());
  if (moved.allFinite()) start.alpha = moved;
  return start;
}

Fit refit_beside(const Rows& rows, const Fit& fit, const Model& model, const RefitOptions& options) {
  return refit(rows, model, start_beside(rows, fit, model), options);
}

}  // namespace rangecal::diagnosis
