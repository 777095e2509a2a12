// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <optional>

#include "pairs_ml/dense_newton.hpp"
#include "rangecal/solvers/fleet/population.hpp"

namespace rangecal {

/// -log posterior of (alpha, s = log sigma) of one unit, the population its prior N(mu, C).
class PosteriorInPopulation {
 public:
  PosteriorInPopulation(const PairsProblem& problem, const Population& population,
                        const Eigen::MatrixXd& precision)
      : problem_(problem), population_(population), precision_(precision), n_(population.mean.size() - 1) {}

  PairsDerivatives derivatives(const Eigen::VectorXd& x) const {
    PairsDerivatives d = pairs_derivatives(problem_, x.head(n_),
                                           {population_.law, Eigen::VectorXd::Constant(1, std::exp(x[n_]))});
    const Eigen::VectorXd e = x - population_.mean, pull = precision_ * e;
    d.nll += 0.5 * e.dot(pull);
    d.gradient += pull;
    d.hessian += precision_;
    d.information += precision_;
    return d;
  }

  /// s where alpha is integrated out, and alpha at its best for it:
  ///   g(s) = min over alpha of -log posterior + 1/2 log det A(s),   A its information in alpha.
  /// The maximum of both together has sigma too low, by half a unit of log sigma where six readings fit a curve. Var s = 1 / g'',
  /// cov alpha = A^-1 + a a^T Var s with a = d alpha / d s.
  struct Marginal {
    Eigen::VectorXd x;
    Eigen::MatrixXd covariance;
  };
  std::optional<Marginal> marginal(const Eigen::VectorXd& joint) const {
    constexpr double step = 0.05;
    const double reach = std::max(3.0, 6.0 * std::sqrt(population_.spread()(n_, n_)));
    Eigen::VectorXd warm = joint;
    const auto g = [&](double s) { return profile(s, warm); };
    const double s = boost::math::tools::brent_find_minima(g, joint[n_] - reach, joint[n_] + reach, 26).first;
    const double here = g(s);
    const Eigen::VectorXd x = warm;
    const double below = g(s - step), above = g(s + step),
                 curvature = (above - 2.0 * here + below) / (step * step);
    if (!(curvature > 0.0) || !(std::max({below, here, above}) < none)) return std::nullopt;
    const Eigen::MatrixXd information = derivatives(x).information;
    const Eigen::LLT<Eigen::MatrixXd> factor(information.topLeftCorner(n_, n_));
    if (factor.info() != Eigen::Success) return std::nullopt;
    const Eigen::VectorXd turn = -factor.solve(information.col(n_).head(n_));
    Marginal result{x, Eigen::MatrixXd(n_ + 1, n_ + 1)};
    const double variance = 1.0 / curvature;
    result.covariance << factor.solve(Eigen::MatrixXd::Identity(n_, n_)) + turn * turn.transpose() * variance,
        turn * variance, turn.transpose() * variance, variance;
    return result;
  }

 private:
  static constexpr double none = 1e300;

  /// g(s); `x` moves to (alpha at its best, s).
  double profile(double s, Eigen::VectorXd& x) const {
    Eigen::VectorXd at = x;
    at[n_] = s;
    const pairs_ml::DenseNewton best = pairs_ml::minimise(
        [&](const Eigen::VectorXd& alpha) {
          Eigen::VectorXd both(n_ + 1);
          both << alpha, s;
          PairsDerivatives d = derivatives(both);
          d.gradient.conservativeResize(n_);
          d.hessian.conservativeResize(n_, n_);
          d.information.conservativeResize(n_, n_);
          return d;
        },
        Eigen::VectorXd(at.head(n_)));
    if (best.outcome != Outcome::converged) return none;
    const Eigen::LLT<Eigen::MatrixXd> factor(best.at.information);
    if (factor.info() != Eigen::Success) return none;
    x << best.x, s;
    return best.at.nll + factor.matrixLLT().diagonal().array().log().sum();
  }

  const PairsProblem& problem_;
  const Population& population_;
  const Eigen::MatrixXd& precision_;
  Eigen::Index n_;
};

}  // namespace rangecal
