// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/outcome.hpp"

namespace rangecal {

/// Which powers of d carry the curve.
enum class PolynomialBasis {
  all_powers,  ///< f(d) = sum_{i=0..n} alpha_i d^i        (Alhashimi 2016, eq. 3; 2021, eq. 26)
  odd_powers   ///< f(d) = sum_{i=0..n} alpha_i d^(2i+1)   (2016, eq. 2: radial distortion, for comparison)
};

struct PolynomialFit {
  Outcome outcome = Outcome::failed;  ///< converged; too_few_data (readings, or different distances)
  std::string reason;
  Eigen::VectorXd alpha;     ///< order + 1 coefficients in the basis asked for
  Eigen::MatrixXd cofactor;  ///< (H^T W H)^-1: times sigma^2 it is the covariance of alpha
  double rss = 0.0;          ///< sum_k w_k (y_k - f(d_k))^2
  double sigma_sq_ml = 0.0;  ///< rss / N: the ML variance of a reading of weight 1
  double sigma_sq = 0.0;     ///< rss / (N - n - 1): corrected for degrees of freedom; 0 where none are left
  double nll = 0.0;          ///< Gaussian NLL at sigma_sq_ml [nats], constants included
  double condition = 0.0;    ///< of the weighted design in the centred and scaled basis

  bool usable() const { return outcome == Outcome::converged; }
};

/// argmin over alpha of sum_k w_k (y_k - f(d_k))^2, by column-pivoted Householder QR in powers of (d -
/// centre) / half range, then expanded into powers of d. y, d in metres, w_k = 1 where `weights` is empty;
/// sigma^2 / w_k is the variance of reading k. Source: 2016 eq. 25, 2021 eq. 26-28. Precondition: equal
/// sizes, finite numbers, weights > 0 (else InputError). Cannot work with fewer readings than coefficients or
/// fewer different distances than coefficients (too_few_data): alpha is then empty. Cost: O(N n^2).
PolynomialFit fit_polynomial(std::span<const double> d, std::span<const double> y, int order,
                             std::span<const double> weights = {},
                             PolynomialBasis basis = PolynomialBasis::all_powers);

/// sum_i alpha_i d^i or sum_i alpha_i d^(2i+1).
double evaluate_in_basis(const Eigen::VectorXd& alpha, double d, PolynomialBasis basis);

enum class OrderCriterion {
  aic,
  aicc,
  bic,
  cross_validation,  ///< mean squared (weighted) error of left-out folds
  thirds             ///< a third to fit, a third for the order, a third to test (2021, section 3.2 and 4)
};

/// "aic", "aicc", "bic", "cv", "thirds"; the inverse also reads "cross-validation" and throws InputError for another text.
const char* to_string(OrderCriterion criterion);
OrderCriterion order_criterion_from_string(const std::string& text);
/// True for those that leave readings out and so judge orders alone, not noise laws.
inline bool leaves_out(OrderCriterion criterion) {
  return criterion == OrderCriterion::cross_validation || criterion == OrderCriterion::thirds;
}

struct OrderOptions {
  int min_order = 0, max_order = 5;  ///< orders tried
  OrderCriterion criterion = OrderCriterion::aic;
  int folds = 10;          ///< of the cross-validation
  std::uint64_t seed = 1;  ///< of the random split into folds or thirds
  PolynomialBasis basis = PolynomialBasis::all_powers;
};

struct OrderSelection {
  Outcome outcome = Outcome::failed;  ///< converged; too_few_data where no order could be scored
  std::string reason;
  int order = -1;  ///< the one with the lowest score
  int min_order = 0;
  std::vector<double> scores;  ///< per order from min_order; +infinity where it could not be fitted.
                               ///< Criteria [nats], or weighted mean squared error [m^2]
  double test_mse = std::numeric_limits<double>::quiet_NaN();  ///< `thirds`: of the last third [m^2]
  PolynomialFit fit;  ///< at `order`: of all readings; with `thirds`, of the first third
};

/// The order with the lowest score; sigma^2 counts as a parameter in AIC, AICc and BIC. Arguments as
/// fit_polynomial.
OrderSelection select_order(std::span<const double> d, std::span<const double> y,
                            const OrderOptions& options = {}, std::span<const double> weights = {});

}  // namespace rangecal
