// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/calibrate.hpp"

namespace rangecal {

/// The curve of one model of the search for order and noise law.
struct TriedCurve {
  double aic =
      0.0;  ///< or the criterion used instead of AIC for the choice [nats]; infinity: the fit did not converge
  Eigen::VectorXd alpha;
  std::optional<Eigen::MatrixXd> covariance;  ///< of alpha, given this model
};

/// A model this far above the lowest AIC has a weight below a thousandth.
constexpr double aic_that_matters = 14.0;

/// Covariance of the curve's coefficients, including the uncertainty of the choice of the model:
///
///   C = sum_i w_i [ C_i + delta_i delta_i^T ],   w_i ~ exp(-AIC_i / 2),   delta_i = alpha_i - alpha,
///
/// with alpha the curve delivered, all padded with zeros to the highest order among the models that matter. The
/// variance of f(d) is then sum_i w_i [ var f_i(d) + (f_i(d) - f(d))^2 ]: each model's own variance, and how far its
/// curve lies from the one delivered. Source: Burnham, Anderson, Model Selection and Multimodel Inference,
/// 2002, eq. 6.12: the variance form, not the sum of w sqrt(.) of Buckland, Burnham, Augustin 1997 (eq. 4.9
/// of the book), about the curve delivered instead of the mean of the models. It can be smaller than the delivered
/// model's own variance, if another model that is about as likely has a smaller variance and the curves agree. None if
/// the curve has no covariance, or if fewer than two models with a covariance have a weight of a thousandth.
std::optional<Eigen::MatrixXd> covariance_with_choice(const Calibration& delivered,
                                                      std::span<const TriedCurve> tried);

/// The noise laws that a search tries: the one asked for, else those of the 2016 paper (eq. 10).
inline std::vector<NoiseLaw> laws_to_try(const CalibrateOptions& options) {
  if (options.noise) return {*options.noise};
  return {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed};
}

using OrderAndLaw = std::pair<int, NoiseLaw>;

/// The search for order and noise law, from `start`: the law of lowest value at that order, then the order of lowest value
/// under that law, then once more, if the order changed, the laws that were not farther behind than ten times what the order
/// gained. `value_of(order, law)` fits a model when first asked for it; `prepare(models)` is told before of those that are to be
/// compared, and may fit them all at once.
template <typename Value, typename Prepare>
OrderAndLaw search_model(const CalibrateOptions& options, int highest, OrderAndLaw start,
                         const Value& value_of, const Prepare& prepare) {
  constexpr double times_the_gain = 10.0;
  std::vector<NoiseLaw> laws = laws_to_try(options);
  int order = start.first;
  NoiseLaw law = start.second;  // no structured binding: clang-14, which builds the fuzzers, captures none
  const auto best_law = [&] {
    std::vector<OrderAndLaw> models{{order, law}};
    for (NoiseLaw candidate : laws)
      if (candidate != law) models.emplace_back(order, candidate);
    prepare(models);
    for (NoiseLaw candidate : laws)
      if (value_of(order, candidate) < value_of(order, law)) law = candidate;
  };
  best_law();
  const int first_order = order;
  std::vector<OrderAndLaw> orders;
  for (int n = 1; !options.order && n <= std::max(1, highest); ++n) orders.emplace_back(n, law);
  prepare(orders);
  for (const auto& [n, its_law] : orders)
    if (value_of(n, its_law) < value_of(order, law)) order = n;
  if (order == first_order) return {order, law};
  const double first_value = value_of(first_order, law);
  const double reach = times_the_gain * (first_value - value_of(order, law)) + aic_that_matters;
  std::erase_if(laws, [&](NoiseLaw one) {
    const double value = value_of(first_order, one);
    return std::isfinite(value) && value > first_value + reach;
  });
  best_law();
  return {order, law};
}
template <typename Value>
OrderAndLaw search_model(const CalibrateOptions& options, int highest, OrderAndLaw start,
                         const Value& value_of) {
  return search_model(options, highest, start, value_of, [](const std::vector<OrderAndLaw>&) {});
}

}  // namespace rangecal
