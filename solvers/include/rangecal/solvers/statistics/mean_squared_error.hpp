// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <limits>
#include <span>

#include "rangecal/core/errors.hpp"

namespace rangecal {

/// (1/N) sum_k (a_k - d_k)^2 [m^2]; NaN for N = 0. Throws InputError where the sizes differ.
inline double mean_squared_error(std::span<const double> true_m, std::span<const double> other_m) {
  if (true_m.size() != other_m.size()) throw InputError("mean_squared_error: sizes differ");
  if (true_m.empty()) return std::numeric_limits<double>::quiet_NaN();
  double sum = 0.0;
  for (std::size_t k = 0; k < true_m.size(); ++k) sum += (other_m[k] - true_m[k]) * (other_m[k] - true_m[k]);
  return sum / static_cast<double>(true_m.size());
}

/// (1/N) sum_k ((a_k - d_k) / d_k)^2 (Alhashimi 2016, eq. 31, 32), dimensionless; NaN for N = 0. Throws
/// InputError where the sizes differ. Precondition: d > 0.
inline double normalised_mean_squared_error(std::span<const double> true_m, std::span<const double> other_m) {
  if (true_m.size() != other_m.size()) throw InputError("normalised_mean_squared_error: sizes differ");
  if (true_m.empty()) return std::numeric_limits<double>::quiet_NaN();
  double sum = 0.0;
  for (std::size_t k = 0; k < true_m.size(); ++k) {
    const double error = (other_m[k] - true_m[k]) / true_m[k];
    sum += error * error;
  }
  return sum / static_cast<double>(true_m.size());
}

/// MSE(d, d~) / MSE(d, d^): how many times smaller the squared error is after correction (2021, eq. 31).
/// Above 1 the calibration helps; infinite where the corrected distances are exact.
inline double mse_ratio(std::span<const double> true_m, std::span<const double> raw_m,
                        std::span<const double> corrected_m) {
  return mean_squared_error(true_m, raw_m) / mean_squared_error(true_m, corrected_m);
}

}  // namespace rangecal
