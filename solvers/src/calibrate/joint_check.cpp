// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "calibrate/landmarks_job.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "rangecal/solvers/nlopt/nlopt_check.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr Eigen::Index most_unknowns = 400;  // SLSQP factors a dense matrix of that size at every step

/// Columns of one standard deviation of (globals, stops) under the expected information at `system`, which is
/// assembled and eliminated: globals by the Schur complement, stops given the globals by their own block.
Eigen::MatrixXd whitening_of(const JointSystem& system) {
  const Eigen::Index globals = system.layout().global_count;
  const Eigen::Index stops = static_cast<Eigen::Index>(system.layout().coordinates);
  Eigen::MatrixXd whitening = Eigen::MatrixXd::Zero(globals + stops, globals + stops);
  const Eigen::MatrixXd outer = whitening_from_information(system.schur());
  whitening.topLeftCorner(globals, globals) = outer;
  for (Eigen::Index j = 0; j < globals; ++j)
    whitening.col(j).tail(stops) = system.back_substitute(outer.col(j), false);
  Eigen::MatrixXd covariance(stops, stops);
  for (Eigen::Index j = 0; j < stops; ++j)
    covariance.col(j) = system.solve_stops(Eigen::VectorXd::Unit(stops, j));
  if (stops > 0)
    whitening.bottomRightCorner(stops, stops) =
        Eigen::MatrixXd(Eigen::LLT<Eigen::MatrixXd>(0.5 * (covariance + covariance.transpose())).matrixL());
  return whitening;
}

}  // namespace

CheckReport check_joint(const LandmarksJob& job, const JointState& seed, const JointFit& fit) {
  CheckReport report;
  if (fit.outcome != Outcome::converged && fit.outcome != Outcome::unobservable) {
    report.report = "no check: the joint likelihood has no optimum here to compare with";
    return report;
  }
  JointSystem system(job.problem, static_cast<int>(seed.alpha.size()),
                     static_cast<int>(seed.noise.parameters.size()));
  const Eigen::Index globals = system.layout().global_count;
  const Eigen::Index stops = static_cast<Eigen::Index>(system.layout().coordinates);
  if (globals + stops > most_unknowns) {
    report.report = fmt::format("no check: {} unknowns, and NLopt's dense methods are for up to {}",
                                globals + stops, most_unknowns);
    return report;
  }
  if (!std::isfinite(system.assemble(seed, HessianKind::fisher)) || !system.eliminate()) {
    report.report = "no check: the seed's information matrix is singular";
    return report;
  }
  const auto state_at = [&](const Eigen::VectorXd& x) {
    return step_state(job.problem, system.layout(), seed, x.head(globals), x.tail(stops));
  };
  NloptProblem problem;
  problem.whitening = whitening_of(system);
  problem.seed = Eigen::VectorXd::Zero(globals + stops);
  problem.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    const JointState state = state_at(x);
    if (!gradient) return joint_nll(job.problem, state);
    const double nll = system.assemble(state, HessianKind::fisher);
    if (std::isfinite(nll)) {
      gradient->resize(globals + stops);
      *gradient << system.global_gradient(), system.stop_gradient();
    }
    return nll;
  };
  const Eigen::Index alphas = seed.alpha.size();
  problem.lower = problem.upper = problem.seed;
  for (Eigen::Index i = 0; i < alphas; ++i) {
    const double reach =
        10.0 * problem.whitening.row(i).norm() + std::abs(fit.state.alpha[i] - seed.alpha[i]);
    problem.lower[i] = -reach;
    problem.upper[i] = reach;
    problem.global_indices.push_back(static_cast<int>(i));
  }
  problem.global_objective = [&](const Eigen::VectorXd& alpha, Eigen::VectorXd*) {
    JointState start = fit.state;
    start.alpha = seed.alpha + alpha;
    JointOptions held;
    held.held.alpha = true;
    held.max_iterations = 30;
    held.gradient_tolerance = 1e-2;
    const JointFit profile = solve_joint_block(job.problem, start, held);
    return profile.outcome == Outcome::unbounded ? infinity : profile.joint_nll;
  };
  NloptOptions options;
  options.reference_nll = fit.joint_nll;
  options.global_evaluations = 200;
  const NloptCheck check = nlopt_check(problem, options);
  report.agrees = check.agrees;
  report.better_basin = check.better_basin;
  report.nll = check.nll;
  report.report = check.report;
  return report;
}

}  // namespace rangecal
