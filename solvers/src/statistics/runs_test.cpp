// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/statistics/runs_test.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

double median_of(std::span<const double> values) {
  std::vector<double> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  const std::size_t half = sorted.size() / 2;
  return sorted.size() % 2 == 1 ? sorted[half] : 0.5 * (sorted[half - 1] + sorted[half]);
}

/// log C(n, k); -infinity where there is no such choice.
double log_choose(int n, int k) {
  if (k < 0 || k > n || n < 0) return -INFINITY;
  return log_gamma(n + 1.0) - log_gamma(k + 1.0) - log_gamma(n - k + 1.0);
}

double probability_of_runs(int r, int n1, int n2) {
  const double all = log_choose(n1 + n2, n1);
  const int k = r / 2;
  if (r % 2 == 0) return 2.0 * std::exp(log_choose(n1 - 1, k - 1) + log_choose(n2 - 1, k - 1) - all);
  return std::exp(log_choose(n1 - 1, k) + log_choose(n2 - 1, k - 1) - all) +
         std::exp(log_choose(n1 - 1, k - 1) + log_choose(n2 - 1, k) - all);
}

double exact_p_value(int runs, int n1, int n2) {
  const int most = std::min(2 * std::min(n1, n2) + 1, n1 + n2);
  double lower = 0.0, upper = 0.0;
  for (int r = 2; r <= most; ++r) {
    const double p = probability_of_runs(r, n1, n2);
    if (r <= runs) lower += p;
    if (r >= runs) upper += p;
  }
  return std::min(1.0, 2.0 * std::min(lower, upper));
}

}  // namespace

RunsTest runs_test(std::span<const double> values, RunsDistribution distribution) {
  for (const double value : values) {
    if (!std::isfinite(value)) throw InputError("runs_test: a value is not finite");
  }
  RunsTest result;
  if (values.empty()) {
    result.outcome = Outcome::too_few_data;
    result.reason = "no values";
    return result;
  }
  const double median = median_of(values);
  int side_before = 0;
  for (const double value : values) {
    const int side = value > median ? 1 : value < median ? -1 : 0;
    if (side == 0) {
      ++result.at_median;
      continue;
    }
    ++(side > 0 ? result.above : result.below);
    if (side != side_before) ++result.runs;
    side_before = side;
  }
  if (result.above == 0 || result.below == 0) {
    result.outcome = Outcome::too_few_data;
    result.reason = "no values on one side of the median: nothing can alternate";
    return result;
  }
  const double n1 = result.above, n2 = result.below, n = n1 + n2, twice = 2.0 * n1 * n2;
  result.expected_runs = 1.0 + twice / n;
  const double variance = twice * (twice - n) / (n * n * (n - 1.0));
  result.z = variance > 0.0 ? (result.runs - result.expected_runs) / std::sqrt(variance) : 0.0;
  result.exact =
      distribution == RunsDistribution::exact || (distribution == RunsDistribution::automatic && n <= 1000.0);
  result.p_value =
      result.exact ? exact_p_value(result.runs, result.above, result.below) : normal_two_sided(result.z);
  result.outcome = Outcome::converged;
  return result;
}

}  // namespace rangecal
