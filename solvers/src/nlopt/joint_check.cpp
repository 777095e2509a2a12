// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/nlopt/joint_check.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "joint_ml/collapse.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

JointCheck check_joint(const JointProblem& problem, const JointState& seed, double reference_nll,
                       NloptOptions options) {
  JointCheck check;
  check.state = seed;
  JointSystem system(problem, static_cast<int>(seed.alpha.size()),
                     static_cast<int>(seed.noise.parameters.size()));
  const JointLayout& layout = system.layout();
  const Eigen::Index globals = layout.global_count, stops = static_cast<Eigen::Index>(layout.coordinates);
  const Eigen::Index unknowns = globals + stops;
  check.reason = unbounded_channel(problem, {});
  if (!check.reason.empty()) return check;
  if (unknowns > max_check_unknowns) {
    check.reason =
        fmt::format("{} unknowns are more than the {} that NLopt is tried on", unknowns, max_check_unknowns);
    return check;
  }
  const auto state_at = [&](const Eigen::VectorXd& x) {
    return step_state(problem, layout, seed, x.head(globals), x.tail(stops));
  };
  NloptProblem nlopt;
  nlopt.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    const double nll = system.assemble(state_at(x), HessianKind::fisher);
    if (gradient) {
      gradient->resize(unknowns);
      *gradient << system.global_gradient(), system.stop_gradient();
    }
    return nll;
  };
  nlopt.seed = Eigen::VectorXd::Zero(unknowns);
  system.assemble(seed, HessianKind::fisher);
  nlopt.whitening = whitening_from_information(system.dense_hessian());

  // alpha_i d^i may change by 0.3 of the largest reading at the largest distance.
  const std::vector<double>& readings = problem.cells.range_mean;
  const double reach = readings.empty() ? 1.0 : *std::max_element(readings.begin(), readings.end());
  nlopt.upper = Eigen::VectorXd::Constant(unknowns, 1.0);
  for (int i = 0; i < layout.alpha_count; ++i) {
    nlopt.upper[i] = 0.3 * std::pow(std::max(reach, 1e-3), 1 - i);
    nlopt.global_indices.push_back(i);
  }
  nlopt.lower = -nlopt.upper;
  nlopt.global_objective = [&](const Eigen::VectorXd& alpha, Eigen::VectorXd*) {
    JointState start = seed;
    start.alpha += alpha;
    JointOptions profile;
    profile.held.alpha = true;
    profile.max_iterations = 30;
    profile.gradient_tolerance = 1e-2;
    const JointFit fit = solve_joint_block(problem, start, profile);
    return fit.outcome == Outcome::unbounded ? std::numeric_limits<double>::infinity() : fit.joint_nll;
  };
  options.reference_nll = reference_nll;
  check.result = nlopt_check(nlopt, options);
  check.state = state_at(check.result.x);
  check.done = true;
  return check;
}

}  // namespace rangecal
