// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/rounding.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rangecal::diagnosis {

RoundingVariance rounding_variance(double step, double spread) {
  if (!(step > 0.0)) return {};
  constexpr double least = 0.005, small = 0.1;  // spread in steps; there either series is exact to 1e-10
  const double total = step * step / 12.0, x = std::max(spread / step, least);
  if (x < small) {
    const double own = step * step * (x * std::numbers::inv_sqrtpi - x * x);
    return {total - own, own};
  }
  const double phase = 2.0 * std::numbers::pi * x;
  double sum = 0.0;
  for (int k = 1; k <= 12; ++k) {
    const double square = static_cast<double>(k) * k, term = std::exp(-phase * phase * square) / square;
    sum += term;
    if (term < 1e-13) break;
  }
  const double shared = step * step / (2.0 * std::numbers::pi * std::numbers::pi) * sum;
  return {shared, total - shared};
}

}  // namespace rangecal::diagnosis
