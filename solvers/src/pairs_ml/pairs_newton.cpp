// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_newton.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "solver_log.hpp"

namespace rangecal::pairs_ml {
namespace {

constexpr double switch_norm = 1e-4;  // below this Newton decrement the next step lands on the optimum

double norm_in(const Matrix& metric, const Vector& gradient, int free) {
  const Eigen::LLT<Matrix> factor(metric.topLeftCorner(free, free));
  if (factor.info() != Eigen::Success) return std::numeric_limits<double>::infinity();
  Vector white = gradient.head(free);
  factor.matrixL().solveInPlace(white);
  return white.norm();
}

NewtonResult newton_minimum(const ScaledPairs& pairs, Vector x, int free, int max_iterations,
                            double tolerance, const SolverLog& log) {
  NewtonResult result;
  Evaluation first, second;  // swapped by address: they are kilobytes
  Evaluation *at = &first, *trial = &second;
  pairs.evaluate(x, false, *at);
  bool has_information = false;
  if (!at->valid) {
    result.x = x;
    return result;
  }
  double last_norm = std::numeric_limits<double>::infinity();
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    result.iterations = iteration;
    Eigen::LLT<Matrix> factor(at->hessian.topLeftCorner(free, free));
    bool by_information = false;
    if (factor.info() != Eigen::Success || (at->hessian.diagonal().head(free).array() <= 0.0).any()) {
      if (!has_information) {
        pairs.evaluate(x, true, *at);
        has_information = true;
      }
      factor.compute(at->information.topLeftCorner(free, free));
      by_information = true;
      if (factor.info() != Eigen::Success) {
        result.outcome = Outcome::failed;
        break;
      }
    }
    Vector step = -factor.solve(at->gradient.head(free));
    const double decrement = std::sqrt(std::fmax(0.0, -step.dot(at->gradient.head(free))));
    if (!std::isfinite(decrement)) break;
    if (has_information) {
      result.gradient_norm = norm_in(at->information, at->gradient, free);
      // Rounding sets a floor; a norm that no longer falls below 1e-6 is that floor.
      if (result.gradient_norm < tolerance || (result.gradient_norm < 1e-6 && decrement >= 0.5 * last_norm)) {
        result.outcome = Outcome::converged;
        break;
      }
    }
    const bool near = decrement < switch_norm;
    if (pairs.log_sigma() && free == pairs.unknowns()) {
      // For fixed coefficients log sigma has its optimum at log(S / N) / 2, S the sum of squares in units of s, of
      // which the step takes the first order, over 2 S by the Hessian and over 2 N by the information: the rest is added.
      // Of second order, so the speed near the optimum stays.
      const double squares = 0.5 * at->hessian(free - 1, free - 1),
                   readings = at->gradient[free - 1] + squares;
      if (squares > 0.0 && readings > 0.0) {
        const double first = by_information ? squares / readings - 1.0 : 1.0 - readings / squares;
        step[free - 1] += 0.5 * std::log(squares / readings) - 0.5 * first;
      }
    }
    last_norm = decrement;

    const double slack = 1e-12 * (1.0 + std::abs(at->nll));
    double scale = 1.0;
    bool moved = false;
    for (int cut = 0; cut < 40 && !moved; ++cut, scale *= 0.25) {
      Vector next = x;
      next.head(free) += scale * step;
      pairs.evaluate(next, near, *trial);
      if (trial->valid && trial->nll <= at->nll - 1e-4 * scale * decrement * decrement + slack) {
        x = next;
        std::swap(at, trial);
        has_information = near;
        moved = true;
      }
    }
    log.iteration(iteration, at->nll, moved ? 4.0 * scale * decrement : 0.0, decrement,
                  {"length", moved ? 4.0 * scale : 0.0});
    if (!moved) {
      if (!has_information) pairs.evaluate(x, true, *at);
      result.gradient_norm = norm_in(at->information, at->gradient, free);
      has_information = true;
      result.outcome = result.gradient_norm < 1e-6 ? Outcome::converged : Outcome::not_converged;
      break;
    }
    if (iteration == max_iterations) result.outcome = Outcome::not_converged;
  }
  if (!has_information) {
    pairs.evaluate(x, true, *at);
    result.gradient_norm = norm_in(at->information, at->gradient, free);
  }
  result.x = x;
  result.at = std::move(*at);
  return result;
}

}  // namespace

NewtonResult minimise(const ScaledPairs& pairs, Vector x, int free, int max_iterations, double tolerance) {
  const SolverLog log("pairs newton");
  NewtonResult result = newton_minimum(pairs, std::move(x), free, max_iterations, tolerance, log);
  log.end(result.iterations, result.at.nll, result.gradient_norm, result.outcome);
  return result;
}

}  // namespace rangecal::pairs_ml
