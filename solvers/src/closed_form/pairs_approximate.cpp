// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/pairs_approximate.hpp"

#include <cmath>
#include <limits>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"

namespace rangecal {

PairsApproximate approximate_pairs_fit(std::span<const double> d, std::span<const double> y, int order) {
  std::vector<double> weights(d.size());
  for (std::size_t k = 0; k < d.size(); ++k) {
    if (!(d[k] > 0.0))
      throw InputError("approximate_pairs_fit: distance " + std::to_string(k) + " is not positive");
    weights[k] = std::pow(d[k], -4);
  }
  const PolynomialFit fit = fit_polynomial(d, y, order, weights);
  PairsApproximate result;
  result.outcome = fit.outcome;
  result.reason = fit.reason;
  if (!fit.usable()) return result;

  result.alpha = fit.alpha;
  result.sigma_e_sq_printed = fit.sigma_sq_ml;
  result.nll = fit.nll;
  const double N = static_cast<double>(d.size()), dof = N - (order + 1);
  if (dof > 0.0) result.alpha_covariance = fit.sigma_sq * fit.cofactor;
  double sum = 0.0;
  for (std::size_t k = 0; k < d.size(); ++k) {
    const double f = evaluate_polynomial(fit.alpha, d[k]);
    if (!(f > 0.0)) sum = std::numeric_limits<double>::quiet_NaN();
    sum += std::pow((y[k] - f) / (f * f), 2);
  }
  result.sigma_e_sq_reweighted = dof > 0.0 ? sum / dof : 0.0;
  return result;
}

}  // namespace rangecal
