// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/nlopt/nlopt_check.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <nlopt.hpp>
#include <stdexcept>

#include "rangecal/core/errors.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

constexpr double wall = 1e30;  // stands for an infinite objective, which NLopt's line searches cannot take

struct Local {
  const NloptProblem* problem = nullptr;
  Eigen::VectorXd origin;
  Eigen::MatrixXd whitening;
  double offset =
      0.0;  // objective at the start: NLopt's tolerances then see differences, not a large constant
  Eigen::VectorXd best_u;
  double best = 0.0;
  int evaluations = 0;
};

double local_objective(const std::vector<double>& u, std::vector<double>& gradient, void* data) {
  Local& local = *static_cast<Local*>(data);
  const Eigen::Map<const Eigen::VectorXd> at(u.data(), static_cast<Eigen::Index>(u.size()));
  const Eigen::VectorXd x = local.origin + local.whitening * at;
  Eigen::VectorXd in_x;
  ++local.evaluations;
  const double value = local.problem->objective(x, gradient.empty() ? nullptr : &in_x);
  if (!std::isfinite(value) || (!gradient.empty() && !in_x.allFinite())) {
    // Outwards is uphill, so that the search turns back.
    const double norm = std::fmax(at.norm(), 1e-12);
    for (std::size_t i = 0; i < gradient.size(); ++i) gradient[i] = u[i] / norm * 1e3;
    return wall;
  }
  if (!gradient.empty()) {
    Eigen::Map<Eigen::VectorXd>(gradient.data(), in_x.size()) = local.whitening.transpose() * in_x;
  }
  const double difference = value - local.offset;
  if (difference < local.best) {
    local.best = difference;
    local.best_u = at;
  }
  return difference;
}

struct Algorithm {
  nlopt::algorithm id;
  const char* name;
};
constexpr Algorithm algorithms[] = {{nlopt::LD_LBFGS, "LD_LBFGS"},
                                    {nlopt::LD_TNEWTON_PRECOND_RESTART, "LD_TNEWTON_PRECOND_RESTART"},
                                    {nlopt::LD_SLSQP, "LD_SLSQP"}};

/// One algorithm from x; returns the best point it saw and its objective.
double run_local(const NloptProblem& problem, const Algorithm& algorithm, int budget, Eigen::VectorXd& x,
                 int& evaluations) {
  Local local;
  local.problem = &problem;
  local.origin = x;
  local.whitening = problem.whitening;
  local.offset = problem.objective(x, nullptr);
  local.best_u = Eigen::VectorXd::Zero(x.size());
  nlopt::opt optimiser(algorithm.id, static_cast<unsigned>(x.size()));
  optimiser.set_min_objective(local_objective, &local);
  optimiser.set_maxeval(budget);
  optimiser.set_ftol_abs(1e-13);
  optimiser.set_xtol_abs(1e-10);  // in standard deviations
  std::vector<double> u(static_cast<std::size_t>(x.size()), 0.0);
  double reached = 0.0;
  try {
    optimiser.optimize(u, reached);
  } catch (const nlopt::roundoff_limited&) {
    // The best point seen stands.
  } catch (const std::runtime_error&) {
    // A line search that failed: the same.
  }
  evaluations += local.evaluations;
  x = local.origin + local.whitening * local.best_u;
  return local.offset + local.best;
}

/// Algorithms in turn until none of them gains.
double polish(const NloptProblem& problem, const NloptOptions& options, Eigen::VectorXd& x, int& evaluations,
              std::string& name) {
  const SolverLog log("nlopt");
  double nll = problem.objective(x, nullptr);
  int runs = 0;
  for (int round = 0; round < 6; ++round) {
    const double before = nll;
    for (const Algorithm& algorithm : algorithms) {
      Eigen::VectorXd trial = x;
      const double reached = run_local(problem, algorithm, options.local_evaluations, trial, evaluations);
      if (reached < nll) {
        if (nll - reached > 1e-9 || name.empty()) name = algorithm.name;
        nll = reached;
        x = trial;
      }
      log.iteration(++runs, nll, not_known, not_known);
    }
    if (before - nll < 1e-10 * (1.0 + 1e-3 * std::abs(nll))) break;
  }
  log.end(runs, nll, "an iteration is a run of one algorithm");
  return nll;
}

struct Global {
  const NloptProblem* problem = nullptr;
  Eigen::VectorXd base;
  int evaluations = 0;
};

double global_objective(const std::vector<double>& moved, std::vector<double>&, void* data) {
  Global& global = *static_cast<Global*>(data);
  ++global.evaluations;
  const Eigen::Map<const Eigen::VectorXd> at(moved.data(), static_cast<Eigen::Index>(moved.size()));
  double value = 0.0;
  if (global.problem->global_objective) {
    value = global.problem->global_objective(at, nullptr);
  } else {
    Eigen::VectorXd x = global.base;
    for (std::size_t k = 0; k < moved.size(); ++k) x[global.problem->global_indices[k]] = moved[k];
    value = global.problem->objective(x, nullptr);
  }
  return std::isfinite(value) ? value : wall;
}

void check(const NloptProblem& problem) {
  const Eigen::Index size = problem.seed.size();
  if (!problem.objective || size == 0) throw InputError("nlopt_check: objective and seed must be given");
  if (problem.whitening.rows() != size || problem.whitening.cols() != size) {
    throw InputError(fmt::format("nlopt_check: whitening is {} x {}, the seed has {}",
                                 problem.whitening.rows(), problem.whitening.cols(), size));
  }
  if (problem.lower.size() != problem.upper.size() ||
      (problem.lower.size() != 0 && problem.lower.size() != size)) {
    throw InputError(fmt::format("nlopt_check: {} lower and {} upper bounds for {} unknowns",
                                 problem.lower.size(), problem.upper.size(), size));
  }
  for (const int index : problem.global_indices) {
    if (index < 0 || index >= size)
      throw InputError(fmt::format("nlopt_check: global index {} of {}", index, size));
  }
  if (!std::isfinite(problem.objective(problem.seed, nullptr))) {
    throw InputError("nlopt_check: the objective is not finite at the seed");
  }
}

}  // namespace

NloptCheck nlopt_check(const NloptProblem& problem, const NloptOptions& options) {
  check(problem);
  NloptCheck result;
  result.x = problem.seed;
  result.local_nll = polish(problem, options, result.x, result.evaluations, result.algorithm);
  result.nll = result.local_nll;
  if (result.algorithm.empty()) result.algorithm = "none (the seed is the minimum)";

  if (problem.lower.size() > 0 && !problem.global_indices.empty()) {
    Global global{&problem, result.x, 0};
    const std::size_t count = problem.global_indices.size();
    std::vector<double> low(count), high(count), at(count);
    for (std::size_t k = 0; k < count; ++k) {
      const int index = problem.global_indices[k];
      low[k] = problem.lower[index];
      high[k] = problem.upper[index];
      at[k] = 0.5 * (low[k] + high[k]);
    }
    nlopt::opt optimiser(nlopt::GN_DIRECT_L, static_cast<unsigned>(count));
    optimiser.set_min_objective(global_objective, &global);
    optimiser.set_lower_bounds(low);
    optimiser.set_upper_bounds(high);
    optimiser.set_maxeval(options.global_evaluations);
    double reached = wall;
    try {
      optimiser.optimize(at, reached);
    } catch (const std::runtime_error&) {
      reached = wall;
    }
    Eigen::VectorXd x = result.x;
    for (std::size_t k = 0; k < count; ++k) x[problem.global_indices[k]] = at[k];
    if (reached < wall && std::isfinite(problem.objective(x, nullptr))) {
      std::string name;
      result.global_nll = polish(problem, options, x, result.evaluations, name);
      if (result.global_nll < result.nll) {
        result.nll = result.global_nll;
        result.x = x;
        result.algorithm = "GN_DIRECT_L, " + name;
      }
    }
    result.evaluations += global.evaluations;
  }

  if (std::isnan(options.reference_nll)) {
    result.report = fmt::format("NLopt reached {:.9g} nats by {}", result.nll, result.algorithm);
    return result;
  }
  const double gain = options.reference_nll - result.nll;  // > 0: NLopt went lower
  result.better_basin = gain > options.agreement;
  result.agrees = std::abs(gain) <= options.agreement;
  result.report = fmt::format("NLopt ({}) {} by {:.2g} nats{}", result.algorithm,
                              result.agrees ? "agrees"
                              : gain > 0.0  ? "is lower"
                                            : "is higher",
                              std::abs(gain), result.better_basin ? ": a better basin was found" : "");
  return result;
}

Eigen::MatrixXd whitening_from_information(const Eigen::MatrixXd& information) {
  const Eigen::VectorXd scale = information.diagonal().cwiseAbs().cwiseMax(1e-300).cwiseSqrt();
  Eigen::MatrixXd correlation =
      scale.cwiseInverse().asDiagonal() * information * scale.cwiseInverse().asDiagonal();
  double jitter = 0.0;
  for (int attempt = 0; attempt <= 12;
       ++attempt, jitter = jitter == 0.0 ? 1e-12 : jitter * 10.0) {  // up to a tenth
    correlation.diagonal().array() += jitter;
    const Eigen::LLT<Eigen::MatrixXd> factor(correlation);
    if (factor.info() != Eigen::Success) continue;
    const Eigen::Index size = scale.size();
    const Eigen::MatrixXd inverse = factor.matrixU().solve(Eigen::MatrixXd::Identity(size, size));
    return scale.cwiseInverse().asDiagonal() * inverse;
  }
  return scale.cwiseInverse().asDiagonal();
}

}  // namespace rangecal
