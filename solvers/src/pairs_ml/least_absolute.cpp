// SPDX-License-Identifier: BSD-3-Clause
#include "least_absolute.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::pairs_ml {

void scale_noise(Vector& x, int first, NoiseLaw law, double factor) {
  if (!has_sigma(law)) {
    x.tail(x.size() - first) *= factor;
  } else {
    x[first] += std::log(factor);
  }
}

Vector least_absolute(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law,
                      NoiseLaw relative_to, const Vector& gaussian) {
  const int n = scaled.mean_unknowns();
  const std::size_t size = problem.row_true_m.size();
  PairsProblem rows = pairs_as_rows(problem);
  const std::vector<double> count = rows.count;
  rows.single = false;
  Vector c;
  std::vector<double> deviation(size);
  for (int iteration = 0; iteration < 30; ++iteration) {
    const ScaledPairs plain(rows, n - 1, relative_to, 0, 1 << 30);
    Vector x;
    if (!plain.quick_seed(x)) x = plain.seed();
    if (!x.allFinite()) return {};
    c = x.head(n);
    const Eigen::VectorXd alpha = plain.alpha(x);
    for (std::size_t i = 0; i < size; ++i) {
      const double d = problem.row_true_m[i];
      deviation[i] = std::abs(problem.row_reading_m[i] - evaluate_polynomial(alpha, d));
      if (relative_to == NoiseLaw::d_squared) deviation[i] /= d * d;
    }
    const double median = std::max(upper_median(deviation, problem.row_weight), 1e-12);
    for (std::size_t i = 0; i < size; ++i) rows.weight[i] = count[i] / std::max(deviation[i] / median, 0.05);
  }
  Vector x = gaussian;
  x.head(n) = c;
  x.tail(x.size() - n).setZero();
  if (!has_sigma(law)) x[n] = 1.0;  // sigma = 1, or a constant spread of 1 m, to be scaled
  const Eigen::VectorXd alpha = scaled.alpha(x);
  const Noise unit = scaled.noise(x);
  for (std::size_t i = 0; i < size; ++i) {  // now in units of the law's spread
    const double f = evaluate_polynomial(alpha, problem.row_true_m[i]);
    deviation[i] = std::abs(problem.row_reading_m[i] - f);
    if (unit.power_of_f() > 0 && !(f > 0.0)) return {};
    deviation[i] /= unit.spread(problem.row_true_m[i], f);
  }
  scale_noise(x, n, law,
              std::max(upper_median(deviation, problem.row_weight), 1e-12) / median_of_normal_size);
  return x;
}

}  // namespace rangecal::pairs_ml
