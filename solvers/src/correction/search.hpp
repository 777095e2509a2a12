// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <limits>
#include <vector>

#include "rangecal/solvers/correction/correct.hpp"

namespace rangecal {

/// Distances [m] among which a reading's are sought.
struct SearchedRange {
  double low = 0.0, high = 0.0;
  double width() const { return high - low; }
};

/// Throws InputError for a reading that is not finite and positive, and for a calibration that cannot correct
/// one.
SearchedRange searched_range(const Calibration& calibration, double reading_m,
                             const CorrectionOptions& options);

/// Whether `at` is nearer to a reading y than `than`, neither equal to it. Beside a reading so large that the differences round
/// to the same number the one on its side counts.
inline bool is_nearer(double at, double than, double y) {
  const double own = std::abs(at - y), other = std::abs(than - y);
  return own < other || (own == other && (y > than ? at > than : at < than));
}

/// sqrt(s^2 + var f) of readings at a distance, and how many of these a reading is off.
inline double standard_deviations_off(double difference_m, double spread_m, double curve_variance_m2) {
  const double deviation = std::sqrt(spread_m * spread_m + curve_variance_m2);
  return deviation > 0.0 ? std::abs(difference_m) / deviation : std::numeric_limits<double>::infinity();
}

/// Distances in [low, high], low > 0, at which the curve reads `value` [m], ascending.
std::vector<double> distances_at(const Calibration& calibration, double value, double low, double high);

/// Distances in [low, high] at which the curve turns, f'(d) = 0, ascending: u(d) itself never does.
std::vector<double> turning_points_of(const Calibration& calibration, double low, double high);

/// Index of the root of highest likelihood, the first of equals; -1 where there is none.
int most_likely(const std::vector<CorrectionRoot>& roots);

}  // namespace rangecal
