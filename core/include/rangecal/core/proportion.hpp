// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <utility>

#include "rangecal/core/quantiles.hpp"

namespace rangecal {

/// Wilson's 95 % interval of a proportion p of `hits` in `trials` n: (p + z^2/2n -+ z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n),
/// z = 1.95996. (0, 1) without trials. Of a mean of shares, one per trial, it is an upper limit of the interval's width, since
/// no variable between 0 and 1 scatters more than p(1-p).
inline std::pair<double, double> wilson(double hits, double trials) {
  if (!(trials > 0.0)) return {0.0, 1.0};
  const double n = trials, p = hits / n, z_sq = z95 * z95;
  const double middle = p + z_sq / (2.0 * n),
               half = z95 * std::sqrt(p * (1.0 - p) / n + z_sq / (4.0 * n * n));
  // by rounding the ends at p = 0 and 1 may lie beyond them
  return {std::fmax(0.0, (middle - half) / (1.0 + z_sq / n)),
          std::fmin(1.0, (middle + half) / (1.0 + z_sq / n))};
}

}  // namespace rangecal
