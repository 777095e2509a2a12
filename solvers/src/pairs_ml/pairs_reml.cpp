// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_reml.hpp"

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "solver_log.hpp"

namespace rangecal::pairs_ml {
namespace {

struct Conditional {
  Vector x;
  double half_log_det = std::numeric_limits<double>::quiet_NaN(),
         value = std::numeric_limits<double>::infinity();
  Evaluation at;
};

/// The coefficients at their optimum for the noise in x.
Conditional conditional(const ScaledPairs& pairs, const Vector& x) {
  const int n = pairs.mean_unknowns();
  Conditional out;
  NewtonResult inner = minimise(pairs, x, n, 50, 1e-9);
  if (inner.outcome != Outcome::converged) return out;
  const Eigen::LLT<Matrix> factor(inner.at.hessian.topLeftCorner(n, n));
  if (factor.info() != Eigen::Success) return out;
  out.x = inner.x;
  out.half_log_det = 0.0;
  for (int j = 0; j < n; ++j) out.half_log_det += std::log(factor.matrixLLT()(j, j));
  out.value = inner.at.nll + out.half_log_det;
  out.at = std::move(inner.at);
  return out;
}

NewtonResult reml_minimum(const ScaledPairs& pairs, const NewtonResult& full, int max_iterations,
                          const SolverLog& log) {
  const int n = pairs.mean_unknowns(), size = pairs.unknowns(), m = size - n;
  NewtonResult result = full;
  Conditional at = conditional(pairs, full.x);
  if (!std::isfinite(at.value)) {
    result.outcome = Outcome::failed;
    return result;
  }
  for (int iteration = 1; iteration <= max_iterations; ++iteration) {
    const Matrix& I = at.at.information;
    const Eigen::LLT<Matrix> mean_factor(I.topLeftCorner(n, n));
    const Matrix cross = I.topRightCorner(n, m);
    const Matrix metric = I.bottomRightCorner(m, m) - cross.transpose() * mean_factor.solve(cross);
    const Eigen::LLT<Matrix> factor(metric);
    if (factor.info() != Eigen::Success) {
      result.outcome = Outcome::not_converged;
      break;
    }
    // Central differences of the log-determinant along the path of the coefficients, a tenth of a standard
    // deviation wide: an error of order 1e-3 of a term that is itself 1/N of the noise parameter's spread.
    Vector gradient = at.at.gradient.tail(m);
    const Matrix covariance = factor.solve(Matrix::Identity(m, m));
    for (int j = 0; j < m; ++j) {
      const double step = 0.1 * std::sqrt(covariance(j, j));
      Vector high = at.x, low = at.x;
      high[n + j] += step;
      low[n + j] -= step;
      gradient[j] +=
          (conditional(pairs, high).half_log_det - conditional(pairs, low).half_log_det) / (2.0 * step);
    }
    if (!gradient.allFinite()) {  // next to x the coefficients have no optimum
      result.outcome = Outcome::not_converged;
      break;
    }
    const Vector move = -factor.solve(gradient);
    const double norm = std::sqrt(std::fmax(0.0, -move.dot(gradient)));
    result.iterations = full.iterations + iteration;
    if (norm < 1e-8) {
      result.outcome = Outcome::converged;
      break;
    }
    result.outcome = Outcome::not_converged;
    bool moved = false;
    double scale = 1.0;
    for (int cut = 0; cut < 20 && !moved; ++cut, scale *= 0.5) {
      Vector next = at.x;
      next.tail(m) += scale * move;
      Conditional trial = conditional(pairs, next);
      if (trial.value <= at.value + 1e-10 * (1.0 + std::abs(at.value))) {
        at = std::move(trial);
        moved = true;
      }
    }
    log.iteration(iteration, at.value, moved ? 2.0 * scale * norm : 0.0, norm,
                  {"length", moved ? 2.0 * scale : 0.0});
    if (!moved) {
      result.outcome = norm < 1e-4 ? Outcome::converged : Outcome::not_converged;
      break;
    }
  }
  result.x = at.x;
  result.at = at.at;
  return result;
}

}  // namespace

NewtonResult restricted(const ScaledPairs& pairs, const NewtonResult& full, int max_iterations) {
  const SolverLog log("pairs reml");
  NewtonResult result = reml_minimum(pairs, full, max_iterations, log);
  log.end(result.iterations - full.iterations, result.at.nll, not_known, result.outcome);
  return result;
}

}  // namespace rangecal::pairs_ml
