// SPDX-License-Identifier: BSD-3-Clause
// Speed of the full maximum likelihood of the 2016 problem (law f^2, order 2): ours, a plain Ceres program of the
// same model (autodiff, one block per reading, its default tolerances tightened until it ends within 1e-3 nats of
// the best), our residuals under Ceres, and NLopt (LD_LBFGS, whitened) from a plain start. All distances different.
//
//   pairs_speed [largest N, default 1000000]

#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <limits>
#include <memory>
#include <vector>

#include <ceres/autodiff_cost_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <fmt/format.h>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/nlopt/nlopt_check.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ceres.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace {

using namespace rangecal;   // NOLINT: a program, not a header

PairsProblem simulate(int rows) {
  Random random(seed_from("pairs_speed", {static_cast<std::uint64_t>(rows)}));
  const Eigen::Vector3d alpha(0.0525, 0.8838, 0.0584);
  std::vector<double> d, y;
  for (int i = 0; i < rows; ++i) {
    d.push_back(random.uniform(0.2, 5.0));
    const double f = evaluate_polynomial(alpha, d.back());
    y.push_back(f + 0.02 * f * f * random.normal());
  }
  return make_pairs_problem(d, y);
}

/// ((y - f) / s, sqrt(2 log(s / floor))) with one fixed floor per reading.
struct PlainResidual {
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

double nll_at(const PairsProblem& problem, const Eigen::VectorXd& alpha, double sigma) {
  return pairs_nll(problem, alpha, Noise{NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, sigma)});
}

double plain_ceres(const PairsProblem& problem) {
  Eigen::VectorXd alpha = Eigen::Vector3d(0.0, 1.0, 0.0);
  double log_sigma = std::log(0.1);
  ceres::Problem program;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    const double d = problem.true_m[i];
    program.AddResidualBlock(new ceres::AutoDiffCostFunction<PlainResidual, 2, 3, 1>(
                                 new PlainResidual{d, problem.mean_m[i], 0.001 * d * d}),
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
  return nll_at(problem, alpha, std::exp(log_sigma));
}

double by_nlopt(const PairsProblem& problem) {
  NloptProblem check;
  check.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    const double sigma_sq = std::exp(2.0 * x[3]);
    double nll = 0.0;
    Eigen::Vector4d sum = Eigen::Vector4d::Zero();
    for (std::size_t i = 0; i < problem.size(); ++i) {
      const double d = problem.true_m[i], f = x[0] + d * (x[1] + d * x[2]);
      if (!(f > 0.0)) return std::numeric_limits<double>::infinity();
      const double precision = 1.0 / (sigma_sq * f * f * f * f), r = problem.mean_m[i] - f, q = r * r * precision;
      nll += 2.0 * std::log(f) + x[3] + 0.5 * q;
      const double in_f = -r * precision + 2.0 * (1.0 - q) / f;
      sum += Eigen::Vector4d(in_f, in_f * d, in_f * d * d, 1.0 - q);
    }
    if (gradient) *gradient = sum;
    return nll;
  };
  check.seed = Eigen::Vector4d(0.0, 1.0, 0.0, std::log(0.1));
  check.whitening = whitening_from_information(
      pairs_derivatives(problem, check.seed.head(3), Noise{NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.1)})
          .information);
  const NloptCheck result = nlopt_check(check);
  return nll_at(problem, result.x.head(3), std::exp(result.x[3]));
}

/// Shortest time of one call [s]: batches of at least 1 ms, repeated for 0.3 s or once.
double seconds_of(const std::function<void()>& call) {
  using Clock = std::chrono::steady_clock;
  const auto time = [&](int calls) {
    const auto start = Clock::now();
    for (int i = 0; i < calls; ++i) call();
    return std::chrono::duration<double>(Clock::now() - start).count();
  };
  double best = time(1), spent = best;
  const int calls = std::max(1, static_cast<int>(1e-3 / best));
  while (spent < 0.3) {
    const double once = time(calls);
    spent += once;
    best = std::fmin(best, once / calls);
  }
  return best;
}

}  // namespace

int main(int count, char** arguments) {
  const int largest = count > 1 ? std::atoi(arguments[1]) : 1000000;
  fmt::print("{:>8} {:>12} {:>12} {:>14} {:>14} {:>14}   NLL above the best [nats]: ours, threads, Ceres, plain, NLopt\n",
             "N", "ours [us]", "1 thread[us]", "our Ceres (x)", "plain Ceres(x)", "NLopt (x)");
  for (int rows = 100; rows <= largest; rows *= 10) {
    const PairsProblem problem = simulate(rows);
    PairsOptions serial;
    serial.parallel_from = std::numeric_limits<int>::max();
    double nll[5];
    const double ours = seconds_of([&] { nll[0] = full_pairs(problem).nll; });
    const double single = seconds_of([&] { nll[1] = full_pairs(problem, serial).nll; });
    const double mixed = seconds_of([&] { nll[2] = full_pairs_ceres(problem, 2).nll; });
    const double plain = seconds_of([&] { nll[3] = plain_ceres(problem); });
    const double quasi = seconds_of([&] { nll[4] = by_nlopt(problem); });
    double best = nll[0];
    for (const double value : nll) best = std::fmin(best, value);
    fmt::print("{:>8} {:>12.1f} {:>12.1f} {:>14.1f} {:>14.1f} {:>14.1f}  ", rows, 1e6 * ours, 1e6 * single, mixed / ours,
               plain / ours, quasi / ours);
    for (const double value : nll) fmt::print(" {:.1e}", value - best);
    fmt::print("\n");
  }
  return 0;
}
