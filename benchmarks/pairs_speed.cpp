// SPDX-License-Identifier: BSD-3-Clause
// Speed of the full maximum likelihood of the 2016 problem (law f^2, order 2): ours, a plain Ceres program of the
// same model (autodiff, one block per reading, its default tolerances tightened until it ends within 1e-3 nats of
// the best), our residuals under Ceres, and NLopt (LD_LBFGS, whitened) from a plain start. All distances different.
// "reads": time on one thread over that of reading both columns once (their scalar product by Eigen).
//
//   pairs_speed [largest N, default 1000000]

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <limits>

#include "pairs_programs.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ceres.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

int main(int count, char** arguments) {
  using namespace rangecal;
  using namespace rangecal::benchmark;
  const int largest = count > 1 ? std::atoi(arguments[1]) : 1000000;
  fmt::print(
      "{:>8} {:>12} {:>12} {:>6} {:>14} {:>14} {:>14}   NLL above the best [nats]: ours, 1 thread, Ceres, plain, NLopt\n",
      "N", "ours [us]", "1 thread[us]", "reads", "our Ceres (x)", "plain Ceres(x)", "NLopt (x)");
  for (int rows = 100; rows <= largest; rows *= 10) {
    const PairsProblem problem = simulate_pairs(rows);
    PairsOptions serial;
    serial.parallel_from = std::numeric_limits<int>::max();
    double nll[5];
    const double ours = seconds_of([&] { nll[0] = full_pairs(problem).nll; });
    const double single = seconds_of([&] { nll[1] = full_pairs(problem, serial).nll; });
    double product = 0.0;
    const Eigen::Map<const Eigen::VectorXd> d(problem.true_m.data(), rows), y(problem.mean_m.data(), rows);
    const double read = seconds_of([&] { product += d.dot(y); });
    if (!(product > 0.0)) return 1;
    const double mixed = seconds_of([&] { nll[2] = full_pairs_ceres(problem, 2).nll; });
    const double plain = seconds_of([&] { nll[3] = pairs_nll_at(problem, pairs_by_plain_ceres(problem)); });
    const double quasi = seconds_of([&] { nll[4] = pairs_nll_at(problem, pairs_by_nlopt(problem)); });
    double best = nll[0];
    for (const double value : nll) best = std::fmin(best, value);
    fmt::print("{:>8} {:>12.1f} {:>12.1f} {:>6.1f} {:>14.1f} {:>14.1f} {:>14.1f}  ", rows, 1e6 * ours,
               1e6 * single, single / read, mixed / ours, plain / ours, quasi / ours);
    for (const double value : nll) fmt::print(" {:.1e}", value - best);
    fmt::print("\n");
  }
  return 0;
}
