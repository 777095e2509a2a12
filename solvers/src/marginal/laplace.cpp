// SPDX-License-Identifier: BSD-3-Clause
#include "marginal/laplace.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "solver_log.hpp"

namespace rangecal {

namespace {

double settled_stops(JointSystem& system, JointState& state, int& evaluations, double enough,
                     const SolverLog& log) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  constexpr int max_iterations = 40;
  constexpr double least_damping = 1e-4;  // after a step that failed, where none was damped before
  const Eigen::VectorXd still = Eigen::VectorXd::Zero(system.layout().global_count);
  HessianKind kind = HessianKind::exact;
  double nll = system.assemble(state, kind), damping = 0.0, last_damping = 0.0;
  ++evaluations;
  // Steps of the stops need no globals; who asked does.
  const auto settled = [&] { return system.eliminate() ? nll : infinity; };
  if (!std::isfinite(nll)) return infinity;
  // Stops that do not depend on one another are taken each by itself, once, as soon as a step of all of them fails.
  bool to_be_taken = !system.layout().chained;
  const auto each_by_itself = [&] {
    to_be_taken = false;
    if (!system.settle_nodes(state)) return false;
    nll = system.assemble(state, kind = HessianKind::exact);
    ++evaluations;
    return std::isfinite(nll);
  };
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    if (!system.factor_stops(damping)) {
      log.iteration(iteration + 1, nll, 0.0, not_known, {"lambda", damping});
      if (to_be_taken) {
        if (!each_by_itself()) return infinity;
        continue;
      }
      if (kind == HessianKind::exact)
        kind = HessianKind::fisher;
      else
        damping = std::max(10.0 * damping, 1e-10);
      if (damping > 1e8) return infinity;
      system.assemble(state, kind);
      ++evaluations;
      continue;
    }
    const Eigen::VectorXd step = system.solve_stops(-system.stop_gradient());
    const double decrement_sq = -system.stop_gradient().dot(step);
    if (decrement_sq < std::max(enough, 1e-18 * (1.0 + step.size())) && kind == HessianKind::exact &&
        damping == 0.0)
      return settled();
    const JointState trial = step_state(system.problem(), system.layout(), state, still, step);
    const HessianKind next_kind = decrement_sq < 1.0 + 0.1 * step.size() ? HessianKind::exact : kind;
    const double trial_nll = system.assemble(trial, next_kind);
    ++evaluations;
    if (trial_nll <= nll + 1e-12 * (1.0 + std::abs(nll))) {
      state = trial;
      nll = trial_nll;
      kind = next_kind;
      log.iteration(iteration + 1, nll, std::sqrt(decrement_sq), std::sqrt(decrement_sq),
                    {"lambda", damping});
      last_damping = damping;
      damping = damping < 1e-8 ? 0.0 : 0.1 * damping;
      if (decrement_sq < 1e-11 &&
          kind == HessianKind::exact)  // Newton's last step: its square is below rounding
        return settled();
      continue;
    }
    log.iteration(iteration + 1, nll, 0.0, std::sqrt(decrement_sq), {"lambda", damping});
    if (to_be_taken) {
      if (!each_by_itself()) return infinity;
      continue;
    }
    damping = 10.0 * std::max(damping, last_damping > 0.0 ? last_damping : 0.1 * least_damping);
    kind = HessianKind::fisher;
    if (damping > 1e8) return infinity;
    system.assemble(state, kind);
    ++evaluations;
  }
  return infinity;
}

}  // namespace

double settle_stops(JointSystem& system, JointState& state, int& evaluations, double enough) {
  const SolverLog log("stops");
  const int before = evaluations;
  const double nll = settled_stops(system, state, evaluations, enough, log);
  if (log.iterations_on())  // a part of a solve, also where none is told of around it
    log.end(-1, nll, not_known, std::isfinite(nll) ? Outcome::converged : Outcome::failed,
            fmt::format("{} evaluations", evaluations - before));
  return nll;
}

double laplace_nll(const JointSystem& system, double joint_nll) {
  const double dimension = static_cast<double>(system.layout().coordinates);
  return joint_nll + 0.5 * system.log_det_stops() - dimension * half_log_two_pi;
}

double laplace_nll_at(const JointProblem& problem, const JointState& state) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  JointSystem system(problem, static_cast<int>(state.alpha.size()),
                     static_cast<int>(state.noise.parameters.size()));
  for (const HessianKind kind : {HessianKind::exact, HessianKind::fisher}) {
    const double joint_nll = system.assemble(state, kind);
    if (!std::isfinite(joint_nll)) return infinity;
    if (system.eliminate()) return laplace_nll(system, joint_nll);
  }
  return infinity;
}

LaplaceValue laplace_marginal(const JointProblem& problem, const JointState& state) {
  LaplaceValue value;
  value.state = state;
  JointSystem system(problem, static_cast<int>(state.alpha.size()),
                     static_cast<int>(state.noise.parameters.size()));
  int evaluations = 0;
  value.joint_nll = settle_stops(system, value.state, evaluations);
  value.ok = std::isfinite(value.joint_nll);
  value.marginal_nll = value.ok ? laplace_nll(system, value.joint_nll) : value.joint_nll;
  return value;
}

}  // namespace rangecal
