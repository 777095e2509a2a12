// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/noise_order.hpp"

#include <cmath>
#include <numbers>
#include <numeric>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// What the likelihood needs of one batch.
struct BatchSums {
  double size = 0.0, mean = 0.0;
  double successive_sq = 0.0;  ///< sum of (y_k - y_{k-1})^2
  double deviation_sq = 0.0;   ///< sum of (y_k - mean)^2
};

BatchSums sums_of(const std::vector<double>& y) {
  BatchSums sums;
  sums.size = static_cast<double>(y.size());
  sums.mean = std::accumulate(y.begin(), y.end(), 0.0) / sums.size;
  for (std::size_t k = 0; k < y.size(); ++k) {
    sums.deviation_sq += (y[k] - sums.mean) * (y[k] - sums.mean);
    if (k > 0) sums.successive_sq += (y[k] - y[k - 1]) * (y[k] - y[k - 1]);
  }
  return sums;
}

NoiseOrderHypothesis judge(std::span<const BatchSums> batches, int power, DifferenceDivisor divisor) {
  NoiseOrderHypothesis h;
  h.power = power;
  for (const BatchSums& b : batches) {
    const double count = divisor == DifferenceDivisor::printed ? b.size : b.size - 1.0;
    h.sigma_e_sq += b.successive_sq / (2.0 * count * std::pow(b.mean, 2 * power));
  }
  h.sigma_e_sq /= static_cast<double>(batches.size());
  for (const BatchSums& b : batches) {
    const double variance = std::pow(b.mean, 2 * power) * h.sigma_e_sq;
    h.log_likelihood -=
        0.5 * (b.size * std::log(2.0 * std::numbers::pi * variance) + b.deviation_sq / variance);
  }
  return h;
}

}  // namespace

NoiseOrder noise_order(std::span<const std::vector<double>> batches, DifferenceDivisor divisor) {
  NoiseOrder result;
  std::vector<BatchSums> used;
  double spread = 0.0;
  for (const std::vector<double>& batch : batches) {
    for (const double y : batch) {
      if (!std::isfinite(y)) throw InputError("noise_order: a reading is not finite");
    }
    if (batch.size() < 2) {
      ++result.left_out;
      continue;
    }
    used.push_back(sums_of(batch));
    spread += used.back().successive_sq;
    result.batch_mean_m.push_back(used.back().mean);
    result.batch_size.push_back(static_cast<int>(batch.size()));
    if (!(used.back().mean > 0.0)) {
      result.reason = "the mean of a batch is not positive";
      return result;
    }
  }
  if (used.size() < 2) {
    result.outcome = Outcome::too_few_data;
    result.reason = "fewer than 2 batches of at least 2 readings";
    return result;
  }
  if (!(spread > 0.0)) {
    result.reason = "all readings of every batch are equal: there is no noise to judge";
    return result;
  }
  for (int power = 0; power < 4; ++power) {
    result.hypotheses[power] = judge(used, power, divisor);
    if (result.best_power < 0 ||
        result.hypotheses[power].log_likelihood > result.hypotheses[result.best_power].log_likelihood)
      result.best_power = power;
  }
  result.outcome = Outcome::converged;
  return result;
}

std::vector<std::vector<double>> batches_of(const Pairs& pairs) {
  std::vector<std::vector<double>> batches(pairs.batch_labels.size());
  for (std::size_t k = 0; k < pairs.batch.size(); ++k) {
    if (pairs.batch[k] < 0) continue;
    const std::size_t b = static_cast<std::size_t>(pairs.batch[k]);
    if (b >= batches.size()) batches.resize(b + 1);
    batches[b].push_back(pairs.reading_m[k]);
  }
  return batches;
}

NoiseOrder noise_order(const Pairs& pairs, DifferenceDivisor divisor) {
  return noise_order(batches_of(pairs), divisor);
}

std::vector<double> normalised_differences(std::span<const double> readings, double f, int power) {
  std::vector<double> differences;
  for (std::size_t k = 1; k < readings.size(); ++k)
    differences.push_back((readings[k] - readings[k - 1]) / std::pow(f, power));
  return differences;
}

}  // namespace rangecal
