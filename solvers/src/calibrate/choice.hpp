// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <map>
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
/// gained. `values_of(models)` fits those that are not in `known`, all at once if it likes; their values go there.
template <typename Values>
OrderAndLaw search_model(const CalibrateOptions& options, int highest, OrderAndLaw start,
                         std::map<OrderAndLaw, double>& known, const Values& values_of) {
  constexpr double times_the_gain = 10.0;
  OrderAndLaw best = start;
  const auto take_lowest = [&](const std::vector<OrderAndLaw>& models) {
    std::vector<OrderAndLaw> open;
    for (const OrderAndLaw& model : models)
      if (!known.count(model)) open.push_back(model);
    if (!open.empty()) {
      const std::vector<double> values = values_of(open);
      for (std::size_t i = 0; i < open.size(); ++i) known[open[i]] = values[i];
    }
    for (const OrderAndLaw& model : models)
      if (known.at(model) < known.at(best)) best = model;
  };
  std::vector<NoiseLaw> laws = laws_to_try(options);
  const auto take_best_law = [&] {
    std::vector<OrderAndLaw> models{best};
    for (const NoiseLaw law : laws)
      if (law != best.second) models.emplace_back(best.first, law);
    take_lowest(models);
  };
  take_best_law();
  if (options.order) return best;
  const OrderAndLaw first = best;
  std::vector<OrderAndLaw> orders;
  for (int n = 1; n <= std::max(1, highest); ++n) orders.emplace_back(n, first.second);
  take_lowest(orders);
  if (best == first) return best;
  const double reach = times_the_gain * (known.at(first) - known.at(best)) + aic_that_matters;
  std::erase_if(laws, [&](NoiseLaw law) {
    const double value = known.at({first.first, law});
    return std::isfinite(value) && value > known.at(first) + reach;
  });
  take_best_law();
  return best;
}

}  // namespace rangecal
