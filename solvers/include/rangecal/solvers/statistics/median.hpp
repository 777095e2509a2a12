// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "rangecal/core/quantiles.hpp"

namespace rangecal {

/// The middle one of the values, in their unit; of an even number the upper of the two middle ones, so that it always is
/// one of the values. NaN of none. Cost: linear.
inline double upper_median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The same of values that count by weights > 0: the least value up to which more than half of the weight lies. Empty
/// weights: one each. Cost: sorting.
inline double upper_median(const std::vector<double>& values, const std::vector<double>& weights) {
  if (weights.empty() || values.empty()) return upper_median(values);
  std::vector<std::size_t> order(values.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return values[a] < values[b]; });
  const double half = 0.5 * std::accumulate(weights.begin(), weights.end(), 0.0);
  double below = 0.0;
  for (const std::size_t i : order)
    if ((below += weights[i]) > half) return values[i];
  return values[order.back()];
}

/// Standard deviation of normal values about 0 with that median size. NaN of none. Cost: linear.
inline double robust_spread(std::vector<double> values) {
  for (double& value : values) value = std::abs(value);
  return upper_median(std::move(values)) / median_of_normal_size;
}

}  // namespace rangecal
