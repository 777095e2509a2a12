// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/pairs_ml/pairs_ceres.hpp"

#include <ceres/cost_function.h>
#include <ceres/iteration_callback.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "pairs_newton.hpp"
#include "rangecal/problems/pairs/pairs_residual.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// All cells as one block in u: (alpha, noise) = origin + M u, noise as log sigma or beta.
class CellsCost : public ceres::CostFunction {
 public:
  CellsCost(const PairsProblem& problem, NoiseLaw law, Eigen::VectorXd origin, Eigen::MatrixXd M,
            Eigen::Index n)
      : origin_(std::move(origin)), M_(std::move(M)), n_(n) {
    for (std::size_t i = 0; i < problem.size(); ++i) {
      cells_.push_back(
          {problem.true_m[i], problem.mean_m[i], problem.mean_square[i], problem.count[i], law, 0.0});
    }
    repeats_ = !problem.single;
    set_num_residuals(static_cast<int>(cells_.size()) * rows());
    mutable_parameter_block_sizes()->push_back(static_cast<int>(origin_.size()));
  }

  Eigen::VectorXd at(const double* u) const {
    return origin_ + M_ * Eigen::Map<const Eigen::VectorXd>(u, M_.cols());
  }

  /// Sets the floors below the spreads at u; false outside of the domain.
  bool anchor(const double* u) {
    const Eigen::VectorXd x = at(u);
    for (PairsResidual& cell : cells_) {
      const double s = cell.spread(x.head(n_), x.tail(x.size() - n_));
      if (!(s > 0.0)) return false;
      cell.s_floor = s * std::exp(-0.5);
    }
    return true;
  }

  bool Evaluate(double const* const* u, double* residuals, double** jacobians) const override {
    const Eigen::VectorXd x = at(u[0]);
    const Eigen::Index m = x.size() - n_;
    const bool derivatives = jacobians && jacobians[0];
    RowMajor in_alpha(3, n_), in_noise(3, m), all(3, x.size());
    double r[3];
    for (std::size_t i = 0; i < cells_.size(); ++i) {
      if (!cells_[i].evaluate(x.head(n_), x.tail(m), r, derivatives ? in_alpha.data() : nullptr,
                              derivatives ? in_noise.data() : nullptr)) {
        return false;
      }
      const std::size_t first = i * static_cast<std::size_t>(rows());
      residuals[first] = r[0];
      residuals[first + 1] = r[2];
      if (repeats_) residuals[first + 2] = r[1];
      if (!derivatives) continue;
      all << in_alpha, in_noise;
      Eigen::Map<RowMajor> J(jacobians[0] + first * static_cast<std::size_t>(M_.cols()), rows(), M_.cols());
      J.row(0).noalias() = all.row(0) * M_;
      J.row(1).noalias() = all.row(2) * M_;
      if (repeats_) J.row(2).noalias() = all.row(1) * M_;
    }
    return true;
  }

 private:
  int rows() const { return repeats_ ? 3 : 2; }

  std::vector<PairsResidual> cells_;
  Eigen::VectorXd origin_;
  Eigen::MatrixXd M_;
  Eigen::Index n_;
  bool repeats_ = true;
};

/// Tells of the iterations of one run; the unknowns are in standard deviations.
class TellIterations : public ceres::IterationCallback {
 public:
  explicit TellIterations(const SolverLog& log) : log_(log) {}
  int before = 0;           ///< iterations of the runs before
  double nll_at_start = 0;  ///< of this run
  ceres::CallbackReturnType operator()(const ceres::IterationSummary& step) override {
    if (step.iteration == 0) offset_ = nll_at_start - step.cost;
    log_.iteration(before + step.iteration + 1, offset_ + step.cost,
                   step.step_is_successful ? step.step_norm : 0.0, step.gradient_norm,
                   {"radius", step.trust_region_radius});
    return ceres::SOLVER_CONTINUE;
  }

 private:
  const SolverLog& log_;
  double offset_ = 0.0;
};

PairsCeresResult pairs_ceres_fit(const PairsProblem& problem, int order, NoiseLaw law, int noise_order,
                                 const SolverLog& log) {
  PairsCeresResult result;
  const int noise_count = parameter_count(law, noise_order);
  if (problem.readings() < order + 1 + noise_count || static_cast<int>(problem.size()) < order + 1) {
    result.outcome = Outcome::too_few_data;
    result.reason = "fewer readings or distances than unknowns";
    return result;
  }
  const pairs_ml::ScaledPairs scaled(problem, order, law, noise_order, 65536);
  const pairs_ml::Vector seed = scaled.seed();
  pairs_ml::Evaluation start;
  scaled.evaluate(seed, true, start);
  const Eigen::LLT<Eigen::MatrixXd> information(start.information);
  if (!start.valid || information.info() != Eigen::Success || scaled.perfect(seed)) {
    result.reason = "no start inside the model's domain with a regular information matrix";
    return result;
  }
  const Eigen::Index n = order + 1, size = seed.size();
  Eigen::MatrixXd to_user = scaled.jacobian(seed);
  if (has_sigma(law)) to_user(n, n) = 1.0;  // log sigma stays log sigma
  Eigen::VectorXd origin(size);
  const Noise seed_noise = scaled.noise(seed);
  origin.head(n) = scaled.alpha(seed);
  origin.tail(size - n) = seed_noise.parameters;
  if (has_sigma(law)) origin[n] = seed[n];
  const Eigen::MatrixXd W = Eigen::MatrixXd(information.matrixU()).inverse();

  auto* cost = new CellsCost(problem, law, origin, to_user * W, n);  // owned by the program
  Eigen::VectorXd u = Eigen::VectorXd::Zero(size);
  ceres::Problem program;
  program.AddResidualBlock(cost, nullptr, u.data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 3;
  options.max_num_consecutive_invalid_steps = 50;
  options.function_tolerance = 1e-16;
  options.gradient_tolerance = 1e-14;
  options.parameter_tolerance = 1e-16;
  options.initial_trust_region_radius = 1e8;
  options.logging_type = ceres::SILENT;

  TellIterations tell_iterations(log);
  tell_iterations.nll_at_start = start.nll;
  if (log.iterations_on()) options.callbacks.push_back(&tell_iterations);

  double last_norm = std::numeric_limits<double>::infinity();
  result.outcome = Outcome::not_converged;
  for (result.anchorings = 1; result.anchorings <= 200; ++result.anchorings) {
    if (!cost->anchor(u.data())) {
      result.outcome = Outcome::failed;
      break;
    }
    ceres::Solver::Summary summary;
    silence_ceres();
    ceres::Solve(options, &program, &summary);
    result.iterations += static_cast<int>(summary.iterations.size());
    // Where no step was good the trust region has to shrink further than three iterations take it.
    options.max_num_iterations = summary.final_cost < summary.initial_cost ? 3 : 30;
    const Eigen::VectorXd x = cost->at(u.data());
    result.alpha = x.head(n);
    result.noise.law = law;
    result.noise.parameters =
        !has_sigma(law) ? Eigen::VectorXd(x.tail(size - n)) : Eigen::VectorXd::Constant(1, std::exp(x[n]));
    pairs_ml::Evaluation at;
    scaled.evaluate(scaled.from_user(result.alpha, result.noise), true, at);
    const Eigen::LLT<Eigen::MatrixXd> factor(at.information);
    if (!at.valid || factor.info() != Eigen::Success) {
      result.outcome = Outcome::failed;
      break;
    }
    result.gradient_norm = factor.matrixL().solve(Eigen::VectorXd(at.gradient)).norm();
    result.nll = tell_iterations.nll_at_start = at.nll;
    tell_iterations.before = result.iterations;
    // Ceres takes no step whose gain drowns in the rounding of the cost, 1e-16 N: a norm that no longer falls is there.
    const double floor = std::fmax(1e-6, std::sqrt(1e-14 * problem.readings()));
    if (result.gradient_norm < 1e-8 ||
        (result.gradient_norm < floor && result.gradient_norm > 0.5 * last_norm)) {
      result.outcome = Outcome::converged;
      break;
    }
    last_norm = result.gradient_norm;
  }
  if (result.outcome != Outcome::converged) {
    result.reason = fmt::format("stopped at a scaled gradient norm of {:.3g}", result.gradient_norm);
  }
  return result;
}

}  // namespace

PairsCeresResult full_pairs_ceres(const PairsProblem& problem, int order, NoiseLaw law, int noise_order) {
  return followed("pairs ceres", order + 1, law, &PairsCeresResult::nll, [&](const SolverLog& log) {
    return pairs_ceres_fit(problem, order, law, noise_order, log);
  });
}

}  // namespace rangecal
