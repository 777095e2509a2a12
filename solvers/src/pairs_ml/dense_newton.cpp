// SPDX-License-Identifier: BSD-3-Clause
#include "dense_newton.hpp"

#include <Eigen/Cholesky>
#include <cmath>

#include "solver_log.hpp"

namespace rangecal::pairs_ml {

DenseNewton minimise(const std::function<PairsDerivatives(const Eigen::VectorXd&)>& evaluate,
                     Eigen::VectorXd x) {
  const SolverLog log("dense newton");
  DenseNewton result{std::move(x), {}};
  result.at = evaluate(result.x);
  if (!std::isfinite(result.at.nll)) result.outcome = Outcome::failed;
  while (result.outcome == Outcome::not_converged && ++result.iterations <= 200) {
    const PairsDerivatives& now = result.at;
    const Eigen::VectorXd scale = now.information.diagonal().cwiseSqrt().cwiseInverse();
    Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * now.hessian * scale.asDiagonal());
    if (factor.info() != Eigen::Success)
      factor.compute(scale.asDiagonal() * now.information * scale.asDiagonal());
    if (factor.info() != Eigen::Success) break;
    const Eigen::VectorXd step = -scale.cwiseProduct(factor.solve(scale.cwiseProduct(now.gradient)));
    const double decrement_sq = -step.dot(now.gradient), slack = 1e-12 * (1.0 + std::abs(now.nll));
    double length = 1.0;
    PairsDerivatives next = evaluate(result.x + step);
    for (int cut = 0; cut < 40 && !(next.nll <= now.nll - 1e-4 * length * decrement_sq + slack); ++cut) {
      length *= 0.25;
      next = evaluate(result.x + length * step);
    }
    if (!(next.nll <= now.nll + 1e3 * slack)) break;
    result.x += length * step;
    result.at = std::move(next);
    log.iteration(result.iterations, result.at.nll, length * std::sqrt(decrement_sq), std::sqrt(decrement_sq),
                  {"length", length});
    if (decrement_sq < 1e-10) result.outcome = Outcome::converged;
  }
  log.end(result.iterations, result.at.nll, not_known, result.outcome);
  return result;
}

}  // namespace rangecal::pairs_ml
