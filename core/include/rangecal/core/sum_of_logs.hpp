// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

namespace rangecal {

/// log(e^a + e^b), and the part of e^b in the sum: of two densities of a mixture given by their logarithms. NaN where a or b is.
struct SumOfLogs {
  double log_sum, part;
};
inline SumOfLogs sum_of_logs(double a, double b) {
  constexpr double far = 700.0;  // e^-far is next to nothing, and slow to find where it underflows
  const double apart = std::abs(a - b), smaller = apart > far ? 0.0 : std::exp(-apart);  // over the larger
  return {std::fmax(a, b) + std::log(1.0 + smaller), (b > a ? 1.0 : smaller) / (1.0 + smaller)};
}

}  // namespace rangecal
