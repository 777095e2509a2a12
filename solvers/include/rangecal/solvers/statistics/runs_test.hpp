// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>

#include "rangecal/core/outcome.hpp"

namespace rangecal {

/// How the p-value of the runs test is found. `automatic`: exact up to 1000 values, normal above.
enum class RunsDistribution { automatic, exact, normal };

/// The Wald-Wolfowitz runs test about the median (Alhashimi 2016, section 4).
struct RunsTest {
  Outcome outcome = Outcome::failed;  ///< converged; too_few_data where all values are on one side
  std::string reason;
  int above = 0, below = 0;    ///< n1, n2: values above and below the median
  int at_median = 0;           ///< values equal to the median: left out
  int runs = 0;                ///< r
  double expected_runs = 0.0;  ///< 1 + 2 n1 n2 / (n1 + n2)
  double z = 0.0;              ///< (r - expected) / std; below 0: neighbours alike (drift, correlation)
  double p_value = 1.0;        ///< two-sided
  bool exact = false;          ///< p from the exact distribution, else from the normal approximation
};

/// Null hypothesis: the values are in random order (independent, one median). The statistic is the number of
/// runs r of values on one side of the median.
///   exact:  P(r = 2k)     = 2 C(n1-1, k-1) C(n2-1, k-1) / C(n1+n2, n1)
///           P(r = 2k + 1) = [C(n1-1, k) C(n2-1, k-1) + C(n1-1, k-1) C(n2-1, k)] / C(n1+n2, n1)
///           p = min(1, 2 min(P(r <= observed), P(r >= observed)))
///   normal: var r = 2 n1 n2 (2 n1 n2 - n1 - n2) / ((n1 + n2)^2 (n1 + n2 - 1)), no continuity correction
/// Source: Wald and Wolfowitz 1940. Values at the median carry no side and are left out, and counted.
/// Throws InputError if a value is not finite. Cost: O(N log N).
RunsTest runs_test(std::span<const double> values,
                   RunsDistribution distribution = RunsDistribution::automatic);

}  // namespace rangecal
