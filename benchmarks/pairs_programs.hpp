// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/autodiff_cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <functional>
#include <limits>
#include <vector>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/nlopt/nlopt_check.hpp"

namespace rangecal::benchmark {

/// Order 2, law f^2.
struct PairsPoint {
  Eigen::Vector3d alpha{0.0525, 0.8838, 0.0584};
  double sigma = 0.02;
};
/// Where every peer starts.
inline const PairsPoint pairs_start{{0.0, 1.0, 0.0}, 0.1};

/// Readings of the default PairsPoint at distances all different.
inline PairsProblem simulate_pairs(int rows, std::uint64_t set = 0) {
  Random random(seed_from("pairs_speed", {static_cast<std::uint64_t>(rows), set}));
  const PairsPoint truth;
  std::vector<double> d, y;
  for (int i = 0; i < rows; ++i) {
    d.push_back(random.uniform(0.2, 5.0));
    const double f = evaluate_polynomial(truth.alpha, d.back());
    y.push_back(f + truth.sigma * f * f * random.normal());
  }
  return make_pairs_problem(d, y);
}

inline double pairs_nll_at(const PairsProblem& problem, const PairsPoint& at) {
  return pairs_nll(problem, at.alpha, Noise{NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, at.sigma)});
}

/// ((y - f) / s, sqrt(2 log(s / floor))) with one fixed floor per reading.
struct PlainPairsResidual {
  double d, y, floor;
  template <typename T>
  bool operator()(const T* alpha, const T* log_sigma, T* residuals) const {
    const T f = alpha[0] + d * (alpha[1] + d * alpha[2]);
    const T s = exp(log_sigma[0]) * f * f;
    if (!(s > T(floor))) return false;
    residuals[0] = (y - f) / s;
    residuals[1] = sqrt(2.0 * log(s / floor));
    return true;
  }
};

/// What a user of Ceres writes without more ado: automatic derivatives, one residual block per reading.
inline PairsPoint pairs_by_plain_ceres(const PairsProblem& problem) {
  Eigen::Vector3d alpha = pairs_start.alpha;
  double log_sigma = std::log(pairs_start.sigma);
  ceres::Problem program;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    const double d = problem.true_m[i];
    program.AddResidualBlock(new ceres::AutoDiffCostFunction<PlainPairsResidual, 2, 3, 1>(
                                 new PlainPairsResidual{d, problem.mean_m[i], 0.001 * d * d}),
                             nullptr, alpha.data(), &log_sigma);
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 200;
  options.max_num_consecutive_invalid_steps = 50;
  options.function_tolerance = 1e-12;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &program, &summary);
  return {alpha, std::exp(log_sigma)};
}

/// LD_LBFGS on the NLL, whitened by the information at the start.
inline PairsPoint pairs_by_nlopt(const PairsProblem& problem) {
  NloptProblem check;
  check.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    const double sigma_sq = std::exp(2.0 * x[3]);
    double nll = 0.0;
    Eigen::Vector4d sum = Eigen::Vector4d::Zero();
    for (std::size_t i = 0; i < problem.size(); ++i) {
      const double d = problem.true_m[i], f = x[0] + d * (x[1] + d * x[2]);
      if (!(f > 0.0)) return std::numeric_limits<double>::infinity();
      const double precision = 1.0 / (sigma_sq * f * f * f * f), r = problem.mean_m[i] - f,
                   q = r * r * precision;
      nll += 2.0 * std::log(f) + x[3] + 0.5 * q;
      const double in_f = -r * precision + 2.0 * (1.0 - q) / f;
      sum += Eigen::Vector4d(in_f, in_f * d, in_f * d * d, 1.0 - q);
    }
    if (gradient) *gradient = sum;
    return nll;
  };
  check.seed = Eigen::Vector4d(0.0, 1.0, 0.0, std::log(pairs_start.sigma));
  check.whitening = whitening_from_information(
      pairs_derivatives(problem, check.seed.head(3),
                        Noise{NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, pairs_start.sigma)})
          .information);
  const NloptCheck result = nlopt_check(check);
  return {result.x.head(3), std::exp(result.x[3])};
}

/// Shortest time of one call [s]: batches of at least 1 ms, repeated until `spend` [s] is spent, or once.
inline double seconds_of(const std::function<void()>& call, double spend = 0.3) {
  using Clock = std::chrono::steady_clock;
  const auto time = [&](int calls) {
    const auto start = Clock::now();
    for (int i = 0; i < calls; ++i) call();
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  double best = time(1), spent = best;
  const int calls = std::max(1, static_cast<int>(1e-3 / best));
  while (spent < spend) {
    const double once = time(calls);
    spent += once;
    best = std::fmin(best, once / calls);
  }
  return best;
}

}  // namespace rangecal::benchmark
