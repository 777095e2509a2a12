// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <numeric>
#include <optional>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"
#include "rangecal/solvers/statistics/information_criteria.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr auto criterion_names =
    names_of<OrderCriterion>("criterion", {{OrderCriterion::aic, "aic"},
                                           {OrderCriterion::aicc, "aicc"},
                                           {OrderCriterion::bic, "bic"},
                                           {OrderCriterion::cross_validation, "cv"},
                                           {OrderCriterion::cross_validation, "cross-validation"},
                                           {OrderCriterion::thirds, "thirds"}});

/// A subset of the readings.
struct Part {
  std::vector<double> d, y, w;

  void add(double distance, double reading, double weight) {
    d.push_back(distance);
    y.push_back(reading);
    w.push_back(weight);
  }
};

double mean_squared_error(const Part& part, const PolynomialFit& fit, PolynomialBasis basis) {
  double sum = 0.0, weights = 0.0;
  for (std::size_t k = 0; k < part.d.size(); ++k) {
    const double r = part.y[k] - evaluate_in_basis(fit.alpha, part.d[k], basis);
    sum += part.w[k] * r * r;
    weights += part.w[k];
  }
  return sum / weights;
}

/// A fold number 0 .. folds-1 per reading: a random permutation dealt out in turn, so that sizes differ by 1
/// at most.
std::vector<int> deal(std::size_t readings, int folds, std::uint64_t seed) {
  std::vector<std::size_t> order(readings);
  std::iota(order.begin(), order.end(), 0u);
  Random random(seed);
  for (std::size_t k = readings; k > 1; --k) std::swap(order[k - 1], order[random.index(k)]);
  std::vector<int> fold(readings);
  for (std::size_t k = 0; k < readings; ++k)
    fold[order[k]] = static_cast<int>(k % static_cast<std::size_t>(folds));
  return fold;
}

/// The readings split by fold number.
std::vector<Part> split(std::span<const double> d, std::span<const double> y, std::span<const double> weights,
                        int folds, std::uint64_t seed) {
  std::vector<Part> parts(folds);
  const std::vector<int> fold = deal(d.size(), folds, seed);
  for (std::size_t k = 0; k < d.size(); ++k)
    parts[fold[k]].add(d[k], y[k], weights.empty() ? 1.0 : weights[k]);
  return parts;
}

double cross_validation_score(const std::vector<Part>& parts, int order, PolynomialBasis basis) {
  double sum = 0.0, readings = 0.0;
  for (std::size_t out = 0; out < parts.size(); ++out) {
    if (parts[out].d.empty()) continue;
    Part rest;
    for (std::size_t in = 0; in < parts.size(); ++in) {
      if (in == out) continue;
      for (std::size_t k = 0; k < parts[in].d.size(); ++k)
        rest.add(parts[in].d[k], parts[in].y[k], parts[in].w[k]);
    }
    const PolynomialFit fit = fit_polynomial(rest.d, rest.y, order, rest.w, basis);
    if (!fit.usable()) return infinity;
    const double size = static_cast<double>(parts[out].d.size());
    sum += size * mean_squared_error(parts[out], fit, basis);
    readings += size;
  }
  return readings > 0.0 ? sum / readings : infinity;
}

double criterion_score(const PolynomialFit& fit, int order, double N, OrderCriterion criterion) {
  const double p = order + 2.0;  // alpha and sigma^2
  if (!fit.usable() || N <= order + 1) return infinity;
  switch (criterion) {
    case OrderCriterion::aic:
      return aic(fit.nll, p);
    case OrderCriterion::aicc:
      return aicc(fit.nll, p, N);
    default:
      return bic(fit.nll, p, N);
  }
}

}  // namespace

const char* to_string(OrderCriterion criterion) { return criterion_names.name_of(criterion); }

OrderCriterion order_criterion_from_string(const std::string& text) { return criterion_names.value_of(text); }

OrderSelection select_order(std::span<const double> d, std::span<const double> y, const OrderOptions& options,
                            std::span<const double> weights) {
  if (options.min_order < 0 || options.max_order < options.min_order)
    throw InputError("select_order: orders from " + std::to_string(options.min_order) + " to " +
                     std::to_string(options.max_order));
  if (options.folds < 2)
    throw InputError("select_order: folds = " + std::to_string(options.folds) + " is below 2");
  const bool thirds = options.criterion == OrderCriterion::thirds;
  const bool folded = options.criterion == OrderCriterion::cross_validation;
  std::vector<Part> parts;
  if (thirds) parts = split(d, y, weights, 3, options.seed);
  if (folded) parts = split(d, y, weights, options.folds, options.seed);

  OrderSelection selection;
  selection.min_order = options.min_order;
  double best = infinity;
  std::string last_reason = "no readings";
  for (int order = options.min_order; order <= options.max_order; ++order) {
    const PolynomialFit fit = thirds
                                  ? fit_polynomial(parts[0].d, parts[0].y, order, parts[0].w, options.basis)
                                  : fit_polynomial(d, y, order, weights, options.basis);
    double score = infinity;
    if (!fit.usable())
      last_reason = fit.reason;
    else if (thirds)
      score = parts[1].d.empty() ? infinity : mean_squared_error(parts[1], fit, options.basis);
    else if (folded)
      score = cross_validation_score(parts, order, options.basis);
    else
      score = criterion_score(fit, order, static_cast<double>(y.size()), options.criterion);
    selection.scores.push_back(score);
    if (score < best) {
      best = score;
      selection.order = order;
      selection.fit = fit;
    }
  }
  if (selection.order < 0) {
    selection.outcome = Outcome::too_few_data;
    selection.reason = "no order can be scored: " + last_reason;
    return selection;
  }
  if (thirds && !parts[2].d.empty())
    selection.test_mse = mean_squared_error(parts[2], selection.fit, options.basis);
  selection.outcome = Outcome::converged;
  return selection;
}

}  // namespace rangecal
