// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/joint_ml/joint_ml.hpp"

#include <fmt/core.h>

#include <cmath>
#include <limits>

#include "joint_ml/collapse.hpp"
#include "joint_ml/newton_step.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

// Squares of Newton's decrement [nats]: the exact Hessian serves below the first where it is positive definite, the
// spreads are refitted in closed form after steps above the second, and a step below the third is the last.
constexpr double exact_below = 30.0, profile_from = 0.5, last_above = 1e-6;
/// Newton's decrement, in standard deviations, below which one that does not halve any more is rounding, as it is of coordinates far
/// from the origin.
constexpr double rounded_below = 1e-6;

JointFit block_fit(const JointProblem& problem, const JointState& start, const JointOptions& options,
                   const SolverLog& log) {
  JointFit fit;
  fit.state = start;
  share_places(problem.stops, fit.state.stops);
  JointSystem system(problem, static_cast<int>(start.alpha.size()),
                     static_cast<int>(start.noise.parameters.size()));
  const std::vector<int> free = free_globals(system.layout(), options.held);
  HessianKind kind = HessianKind::fisher;
  double nll = system.assemble(fit.state, kind);
  fit.start_nll = fit.joint_nll = nll;
  fit.evaluations = 1;
  if (cannot_start(problem, options.held, fit)) return fit;
  double damping = 0.0, last_norm = std::numeric_limits<double>::infinity();
  bool converged = false;
  const auto tell_step = [&](double step) {
    log.iteration(fit.iterations + 1, nll, step, fit.gradient_norm, {"lambda", damping});
  };
  const auto reassemble = [&](HessianKind wanted) {
    kind = wanted;
    system.assemble(fit.state, kind);
    ++fit.evaluations;
  };
  for (fit.iterations = 0; fit.iterations < options.max_iterations; ++fit.iterations) {
    std::optional<Eigen::VectorXd> globals;
    if (system.eliminate(damping)) globals = newton_step(system.schur(), system.reduced_gradient(), free);
    if (!globals) {
      tell_step(0.0);
      if (kind == HessianKind::exact)
        reassemble(HessianKind::fisher);
      else
        damping = std::max(10.0 * damping, 1e-10);
      if (damping > 1e6) break;
      continue;
    }
    Eigen::VectorXd stops = system.back_substitute(*globals, true);
    const double decrement_sq = -(system.global_gradient().dot(*globals) + system.stop_gradient().dot(stops));
    fit.gradient_norm = std::sqrt(std::max(0.0, decrement_sq));
    const bool rounded = fit.gradient_norm < rounded_below && fit.gradient_norm > 0.5 * last_norm;
    if ((fit.gradient_norm < options.gradient_tolerance || rounded) && damping == 0.0) {
      tell_step(0.0);
      converged = true;
      break;
    }
    last_norm = fit.gradient_norm;
    const double factor = limit_step(system.layout(), fit.state.noise.law, *globals);
    if (factor < 1.0) stops *= factor;
    JointState trial = step_state(problem, system.layout(), fit.state, *globals, stops);
    if (!options.held.sigmas && decrement_sq > profile_from) system.profile_spreads(trial);
    // Newton's decrement is squared from step to step, so below the last bound the trial is the optimum, where the
    // expected information is wanted for the covariance.
    const HessianKind next_kind =
        decrement_sq < exact_below && decrement_sq > last_above ? HessianKind::exact : HessianKind::fisher;
    const double trial_nll = system.assemble(trial, next_kind);
    ++fit.evaluations;
    const double rounding = 1e-12 * (1.0 + std::abs(nll));
    if (trial_nll <= nll + rounding) {
      std::swap(fit.state, trial);
      nll = std::min(nll, trial_nll);
      kind = next_kind;
      tell_step(factor * fit.gradient_norm);
      damping = damping < 1e-8 ? 0.0 : 0.1 * damping;
      const std::string collapsed = options.held.sigmas ? std::string() : collapsed_sigma(start, fit.state);
      if (!collapsed.empty()) {
        fit.outcome = Outcome::unbounded;
        fit.reason = "the joint likelihood has no maximum here: " + collapsed + "; use the marginal method";
        fit.joint_nll = trial_nll;
        return fit;
      }
    } else {
      tell_step(0.0);
      if (decrement_sq < rounding) {  // nothing left to gain but rounding, if that is not the damping's doing
        reassemble(HessianKind::fisher);
        if (damping > 0.0) {
          const auto undamped = system.eliminate()
                                    ? newton_step(system.schur(), system.reduced_gradient(), free)
                                    : std::nullopt;
          if (!undamped) break;
          const double left = -(system.global_gradient().dot(*undamped) +
                                system.stop_gradient().dot(system.back_substitute(*undamped, true)));
          fit.gradient_norm = std::sqrt(std::max(0.0, left));
          if (!(left < std::max(rounding, last_above)))
            break;  // a kink, where a bearing is off by half a turn
        }
        converged = true;
        break;
      }
      reassemble(kind == HessianKind::exact ? HessianKind::fisher : kind);
      damping = std::max(10.0 * damping, 1e-4);
      if (damping > 1e8) break;
    }
  }
  fit.joint_nll = nll;
  fit.outcome = converged ? Outcome::converged : Outcome::not_converged;
  if (!converged)
    fit.reason = fmt::format("no optimum after {} iterations; gradient norm {:.1e}", fit.iterations,
                             fit.gradient_norm);
  if (kind != HessianKind::fisher) reassemble(HessianKind::fisher);
  if (system.eliminate()) describe_covariance(system.schur(), system.layout(), free, fit);
  return fit;
}

}  // namespace

JointFit solve_joint_block(const JointProblem& problem, const JointState& start,
                           const JointOptions& options) {
  return followed("full block", start.alpha.size(), start.noise.law, &JointFit::joint_nll,
                  [&](const SolverLog& log) { return block_fit(problem, start, options, log); });
}

}  // namespace rangecal
