// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>

#include "rangecal/core/outcome.hpp"

namespace rangecal {

/// The Shapiro-Wilk test of normality.
struct ShapiroWilk {
  Outcome outcome =
      Outcome::failed;  ///< converged; too_few_data (N < 3); failed (N > 5000, or all values equal)
  std::string reason;
  double w = 0.0;        ///< in (0, 1]; 1 for a perfectly straight normal plot
  double p_value = 1.0;  ///< small: not normal
};

/// Null hypothesis: the values are independent draws of one normal law.
///   W = (sum_i a_i x_(i))^2 / sum_i (x_i - mean)^2,
/// the squared correlation of the ordered values with approximate normal scores a; 1 - W is transformed to
/// normality for the p-value (exact for N = 3). Source: Royston 1995, algorithm AS R94, N = 3 .. 5000; the
/// p-values agree with R's shapiro.test. Throws InputError if a value is not finite. Cost: O(N log N).
ShapiroWilk shapiro_wilk(std::span<const double> values);

}  // namespace rangecal
