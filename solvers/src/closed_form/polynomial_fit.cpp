// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

void check(std::span<const double> d, std::span<const double> y, int order, std::span<const double> weights) {
  if (d.size() != y.size()) throw InputError("fit_polynomial: as many distances as readings are needed");
  if (!weights.empty() && weights.size() != y.size())
    throw InputError("fit_polynomial: as many weights as readings are needed");
  if (order < 0) throw InputError("fit_polynomial: order " + std::to_string(order) + " is negative");
  for (std::size_t k = 0; k < d.size(); ++k) {
    if (!std::isfinite(d[k]) || !std::isfinite(y[k]))
      throw InputError("fit_polynomial: reading " + std::to_string(k) + " is not finite");
    if (!weights.empty() && !(weights[k] > 0.0 && std::isfinite(weights[k])))
      throw InputError("fit_polynomial: weight " + std::to_string(k) + " is not positive");
  }
}

/// How many distances differ by more than rounding.
int count_distinct(std::span<const double> d) {
  std::vector<double> sorted(d.begin(), d.end());
  std::sort(sorted.begin(), sorted.end());
  const double resolution = 1e-9 * std::max(std::abs(sorted.front()), std::abs(sorted.back()));
  int distinct = 1;
  double last = sorted.front();
  for (const double value : sorted) {
    if (value - last > resolution) {
      ++distinct;
      last = value;
    }
  }
  return distinct;
}

/// T with alpha = T beta, where sum_j beta_j ((d - centre) / scale)^j = sum_i alpha_i d^i: binomial
/// expansion.
Eigen::MatrixXd expansion(int order, double centre, double scale, PolynomialBasis basis) {
  Eigen::MatrixXd T = Eigen::MatrixXd::Zero(order + 1, order + 1);
  if (basis == PolynomialBasis::odd_powers) {
    for (int j = 0; j <= order; ++j) T(j, j) = std::pow(scale, -(2 * j + 1));
    return T;
  }
  for (int j = 0; j <= order; ++j) {
    double binomial = 1.0;
    for (int i = 0; i <= j; ++i) {
      T(i, j) = binomial * std::pow(-centre, j - i) * std::pow(scale, -j);
      binomial *= static_cast<double>(j - i) / (i + 1);
    }
  }
  return T;
}

}  // namespace

double evaluate_in_basis(const Eigen::VectorXd& alpha, double d, PolynomialBasis basis) {
  if (basis == PolynomialBasis::all_powers) return evaluate_polynomial(alpha, d);
  return d * evaluate_polynomial(alpha, d * d);
}

PolynomialFit fit_polynomial(std::span<const double> d, std::span<const double> y, int order,
                             std::span<const double> weights, PolynomialBasis basis) {
  check(d, y, order, weights);
  PolynomialFit fit;
  const Eigen::Index N = static_cast<Eigen::Index>(y.size()), p = order + 1;
  if (N < p) {
    fit.outcome = Outcome::too_few_data;
    fit.reason = std::to_string(N) + " readings for " + std::to_string(p) + " coefficients";
    return fit;
  }
  const int distinct = count_distinct(d);
  if (distinct < p) {
    fit.outcome = Outcome::too_few_data;
    fit.reason = std::to_string(distinct) + " different distance(s) do not determine " + std::to_string(p) +
                 " coefficients of f";
    return fit;
  }
  const auto [low, high] = std::minmax_element(d.begin(), d.end());
  const bool odd = basis == PolynomialBasis::odd_powers;
  const double centre = odd ? 0.0 : 0.5 * (*low + *high);
  double scale = odd ? std::max(std::abs(*low), std::abs(*high)) : 0.5 * (*high - *low);
  if (!(scale > 0.0)) scale = 1.0;

  Eigen::MatrixXd H(N, p);
  Eigen::VectorXd b(N);
  double log_weights = 0.0;
  for (Eigen::Index k = 0; k < N; ++k) {
    const double w = weights.empty() ? 1.0 : weights[k], root = std::sqrt(w);
    const double t = (d[k] - centre) / scale, step = odd ? t * t : t;
    double power = odd ? t : 1.0;
    for (Eigen::Index j = 0; j < p; ++j, power *= step) H(k, j) = root * power;
    b(k) = root * y[k];
    log_weights += std::log(w);
  }
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(H);
  const Eigen::MatrixXd R = qr.matrixR().topLeftCorner(p, p).triangularView<Eigen::Upper>();
  fit.condition = std::abs(R(0, 0)) / std::abs(R(p - 1, p - 1));
  if (!(fit.condition < 1e13)) {
    fit.outcome = Outcome::too_few_data;
    fit.reason = "the distances do not determine " + std::to_string(p) + " coefficients of f to rounding";
    return fit;
  }
  Eigen::VectorXd beta = qr.solve(b);
  beta += qr.solve(b - H * beta);  // one step of iterative refinement
  fit.rss = (b - H * beta).squaredNorm();

  const Eigen::MatrixXd R_inverse = R.triangularView<Eigen::Upper>().solve(Eigen::MatrixXd::Identity(p, p));
  const Eigen::MatrixXd T = expansion(order, centre, scale, basis);
  const Eigen::MatrixXd root = T * (qr.colsPermutation() * R_inverse);
  fit.alpha = T * beta;
  fit.cofactor = root * root.transpose();
  fit.sigma_sq_ml = fit.rss / static_cast<double>(N);
  fit.sigma_sq = N > p ? fit.rss / static_cast<double>(N - p) : 0.0;
  // Residuals below rounding are no evidence for a higher order: the variance in the likelihood stops there.
  const double rounding = 1e-12 * b.cwiseAbs().maxCoeff();
  const double variance = std::max({fit.sigma_sq_ml, rounding * rounding, 1e-300});
  fit.nll =
      0.5 * static_cast<double>(N) * (std::log(2.0 * std::numbers::pi * variance) + 1.0) - 0.5 * log_weights;
  fit.outcome = Outcome::converged;
  return fit;
}

}  // namespace rangecal
