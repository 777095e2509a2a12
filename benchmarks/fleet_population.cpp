// SPDX-License-Identifier: BSD-3-Clause
// A fleet in memory: the time of fitting the units and their population, and how many readings the population saves a new
// unit. Units: alpha ~ N((0.0525, 0.8838, 0.0584), diag(0.01, 0.02, 0.008)^2), sigma log-normal about 0.01 with 20 %,
// s = sigma f^2, distances uniform in 0.3 to 5 m.
//
//   fleet_population [units, default 100000] [readings of each, default 1000]

#include <fmt/format.h>
#include <sys/resource.h>

#include <chrono>
#include <cmath>
#include <cstdlib>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/fleet/population.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace {

using namespace rangecal;
using Clock = std::chrono::steady_clock;

double since(Clock::time_point start) { return std::chrono::duration<double>(Clock::now() - start).count(); }

Eigen::VectorXd draw_unit(Random& random) {
  Eigen::VectorXd theta(4);
  theta << random.normal(0.0525, 0.01), random.normal(0.8838, 0.02), random.normal(0.0584, 0.008),
      random.normal(std::log(0.01), 0.2);
  return theta;
}

PairsProblem readings_of(const Eigen::VectorXd& theta, int count, Random& random) {
  std::vector<double> d, y;
  const Eigen::VectorXd alpha = theta.head(3);
  for (int i = 0; i < count; ++i) {
    d.push_back(random.uniform(0.3, 5.0));
    const double f = evaluate_polynomial(alpha, d.back());
    y.push_back(random.normal(f, std::exp(theta[3]) * f * f));
  }
  return make_pairs_problem(d, y);
}

/// Mean square error of f over 0.5 to 5 m.
double error_sq(const Eigen::VectorXd& alpha, const Eigen::VectorXd& theta) {
  const Eigen::VectorXd delta = alpha - theta.head(3);
  double sum = 0.0;
  for (double d = 0.5; d < 5.01; d += 0.5) sum += std::pow(evaluate_polynomial(delta, d), 2) / 10.0;
  return sum;
}

}  // namespace

int main(int count, char** arguments) {
  const int units = count > 1 ? std::atoi(arguments[1]) : 100000,
            readings = count > 2 ? std::atoi(arguments[2]) : 1000;
  std::vector<UnitSummary> summaries;
  double seconds = 0.0;
  for (int u = 0; u < units; ++u) {
    Random random(seed_from("fleet population", {static_cast<std::uint64_t>(u)}));
    const PairsProblem problem = readings_of(draw_unit(random), readings, random);
    const auto start = Clock::now();
    if (const auto unit = summarise(full_pairs(problem).calibration)) summaries.push_back(*unit);
    seconds += since(start);
  }
  const auto start = Clock::now();
  const Population population = fit_population([&](const std::function<void(const UnitSummary&)>& visit) {
    for (const UnitSummary& unit : summaries) visit(unit);
  });
  const double whole = since(start);
  rusage usage{};
  ::getrusage(RUSAGE_SELF, &usage);
  fmt::print(
      "{} units of {} readings, {} fitted\nfits        {:8.2f} s, {:6.1f} us a unit\npopulation  {:8.2f} s, {} passes, {:.2f} us a unit and pass; {}\n"
      "memory      {:8.0f} MB, of which the summaries are {:.0f}\n",
      units, readings, summaries.size(), seconds, 1e6 * seconds / units, whole, population.iterations,
      1e6 * whole / population.iterations / units, to_string(population.outcome), usage.ru_maxrss / 1024.0,
      300.0 * units / 1e6);
  fmt::print("{:<12} {:>10} {:>10}   true\n", "parameter", "mean", "std");
  const double truth[4][2] = {{0.0525, 0.01}, {0.8838, 0.02}, {0.0584, 0.008}, {std::log(0.01), 0.2}};
  for (int i = 0; i < 4; ++i)
    fmt::print("{:<12} {:>10.5f} {:>10.5f}   {:.5f}, {:.5f}\n",
               i < 3 ? fmt::format("alpha_{}", i) : std::string("log sigma"), population.mean[i],
               std::sqrt(population.covariance(i, i)), truth[i][0], truth[i][1]);

  fmt::print(
      "\nA new unit, RMS error of f from 0.5 to 5 m over 1000 units [mm], and the share of them whose 95 % interval of f(2 m) holds\n"
      "{:>9} {:>14} {:>18} {:>10}\n",
      "readings", "alone", "with population", "coverage");
  for (const int few : {0, 1, 2, 3, 5, 8, 12, 20, 50, 100, 200, 500, 1000}) {
    double alone = 0.0, together = 0.0;
    int held = 0, solved = 0;
    for (std::uint64_t u = 0; u < 1000; ++u) {
      Random random(seed_from("fleet new unit", {u, static_cast<std::uint64_t>(few)}));
      const Eigen::VectorXd theta = draw_unit(random);
      const PairsProblem problem = readings_of(theta, few, random);
      const Calibration fit = calibrate_in_population(problem, population);
      together += error_sq(fit.alpha, theta) / 1000.0;
      const Eigen::Vector3d phi(1.0, 2.0, 4.0);
      held += std::abs(phi.dot(fit.alpha - theta.head(3))) <
              1.96 * std::sqrt(phi.dot(*fit.alpha_covariance * phi));
      if (few < 5) continue;
      const Calibration own = full_pairs(problem).calibration;
      if (own.outcome != Outcome::converged) continue;
      alone += error_sq(own.alpha, theta);
      ++solved;
    }
    fmt::print("{:>9} {:>14} {:>18.2f} {:>9.1f} %\n", few,
               solved > 0 ? fmt::format("{:.2f}", 1e3 * std::sqrt(alone / solved)) : std::string("-"),
               1e3 * std::sqrt(together), held / 10.0);
  }
  return 0;
}
