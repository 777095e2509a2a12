// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/statistics/shapiro_wilk.hpp"

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <numbers>
#include <numeric>
#include <vector>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

double horner(std::initializer_list<double> coefficients, double x) {
  double value = 0.0;
  for (auto c = std::rbegin(coefficients); c != std::rend(coefficients); ++c) value = value * x + *c;
  return value;
}

/// The weights of the upper half of the order statistics, largest first (Royston 1995, section 2): normal
/// scores m, with the one or two outermost weights replaced by a polynomial in 1 / sqrt(N) and the others
/// rescaled so that the squares of all N sum to 1.
std::vector<double> upper_weights(int N) {
  const int half = N / 2;
  if (N == 3) return {std::sqrt(0.5)};
  std::vector<double> m(half);
  double sum_sq = 0.0;
  for (int i = 0; i < half; ++i) {
    m[i] = -normal_quantile((i + 1 - 0.375) / (N + 0.25));
    sum_sq += 2.0 * m[i] * m[i];
  }
  const double norm = std::sqrt(sum_sq), u = 1.0 / std::sqrt(static_cast<double>(N));
  std::vector<double> a(m);
  const int outer = N > 5 ? 2 : 1;
  a[0] = horner({0.0, 0.221157, -0.147981, -2.07119, 4.434685, -2.706056}, u) + m[0] / norm;
  if (outer == 2) a[1] = horner({0.0, 0.042981, -0.293762, -1.752461, 5.682633, -3.582633}, u) + m[1] / norm;
  double rest = sum_sq, left = 1.0;
  for (int i = 0; i < outer; ++i) {
    rest -= 2.0 * m[i] * m[i];
    left -= 2.0 * a[i] * a[i];
  }
  const double factor = std::sqrt(rest / left);
  for (int i = outer; i < half; ++i) a[i] = m[i] / factor;
  return a;
}

double upper_tail(double y, double mean, double sigma) { return normal_below((mean - y) / sigma); }

double p_value_of(double one_minus_w, int N) {
  const double n = N;
  if (N == 3) {
    const double p =
        6.0 / std::numbers::pi * (std::asin(std::sqrt(1.0 - one_minus_w)) - std::numbers::pi / 3.0);
    return std::max(0.0, p);
  }
  const double y = std::log(one_minus_w);
  if (N <= 11) {
    const double gamma = -2.273 + 0.459 * n;
    if (y >= gamma) return 0.0;
    return upper_tail(-std::log(gamma - y), horner({0.544, -0.39978, 0.025054, -6.714e-4}, n),
                      std::exp(horner({1.3822, -0.77857, 0.062767, -0.0020322}, n)));
  }
  const double log_n = std::log(n);
  return upper_tail(y, horner({-1.5861, -0.31082, -0.083751, 0.0038915}, log_n),
                    std::exp(horner({-0.4803, -0.082676, 0.0030302}, log_n)));
}

}  // namespace

ShapiroWilk shapiro_wilk(std::span<const double> values) {
  for (const double value : values) {
    if (!std::isfinite(value)) throw InputError("shapiro_wilk: a value is not finite");
  }
  ShapiroWilk result;
  if (values.size() < 3) {
    result.outcome = Outcome::too_few_data;
    result.reason = "fewer than 3 values";
    return result;
  }
  if (values.size() > 5000) {
    result.reason = "more than 5000 values: the approximation of the p-value ends there";
    return result;
  }
  const int N = static_cast<int>(values.size());
  std::vector<double> x(values.begin(), values.end());
  std::sort(x.begin(), x.end());
  const double range = x.back() - x.front();
  if (!(range > 1e-13 * std::max(std::abs(x.back()), std::abs(x.front())))) {
    result.reason = "all values are equal";
    return result;
  }
  const double mean = std::accumulate(x.begin(), x.end(), 0.0) / N;
  const std::vector<double> a = upper_weights(N);
  double ssa = 0.0, ssx = 0.0, sax = 0.0;
  for (int i = 0; i < N; ++i) {
    const int mirror = N - 1 - i;
    const double weight = i == mirror ? 0.0 : i > mirror ? a[mirror] : -a[i];
    const double deviation = (x[i] - mean) / range;
    ssa += weight * weight;
    ssx += deviation * deviation;
    sax += weight * deviation;
  }
  const double norm = std::sqrt(ssa * ssx);
  const double one_minus_w = std::max((norm - sax) * (norm + sax) / (ssa * ssx), 1e-300);
  result.w = 1.0 - one_minus_w;
  result.p_value = p_value_of(one_minus_w, N);
  result.outcome = Outcome::converged;
  return result;
}

}  // namespace rangecal
