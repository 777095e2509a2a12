// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace rangecal::diagnosis {

/// What rounding to a grid of steps u adds to readings of one mean m and of spread s, m anywhere between the
/// steps.
///
///   e(x) = u round(x / u) - x = sum_k (-1)^k u / (pi k) sin(2 pi k x / u)
///   total variance           u^2 / 12
///   shared by all repeats    E[e(m + s z_1) e(m + s z_2)] = u^2 / (2 pi^2) sum_k exp(-(2 pi k s / u)^2) / k^2
///   own of each              the rest; for s < u / 6 that is u s / sqrt(pi) - s^2 (theta's other series)
///
/// z standard normal, [u] = [s]. Noise of half a step hides the grid: nothing is shared. Without noise all is,
/// and repeats do not average it out. Below s = u / 200 repeats tell no spread, and count as of that one.
/// Source: Widrow, Kollar, "Quantization Noise", 2008, chapter 5 (Fourier series of the error); derived.
struct RoundingVariance {
  double shared = 0.0;  ///< by the repeats of a cell
  double own = 0.0;     ///< of each reading
};
RoundingVariance rounding_variance(double step, double spread);

/// Per cell: what the grids of a model add to ranges [m^2] and bearings [rad^2]; empty without a grid.
struct CellRounding {
  std::vector<RoundingVariance> range, bearing;
};

}  // namespace rangecal::diagnosis
