// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// Readings that lie further from the model than noise would put them: |y - f(d)| > 4 s(d), or a bearing off
/// by more than 4 sigma_theta. Under the model 6.3e-5 of the readings do. Many more means outliers or an
/// effect that the model lacks, either of which inflates the sigmas.
struct ResidualCheck {
  int ranges = 0, bearings = 0;  ///< readings looked at
  int range_outliers = 0, bearing_outliers = 0;
  /// The reading that lies furthest off, and its place, such as "row 57 of pairs.csv".
  struct Farthest {
    double sigmas = 0.0;
    std::string place;
  };
  Farthest farthest_range, farthest_bearing;
  /// Spread of the repeats of one (stop, landmark) over what the calibration states, pooled; 1 where the
  /// noise is independent from reading to reading. Absent where there are fewer than 20 repeats more than
  /// cells.
  std::optional<double> range_repeats, bearing_repeats;
  /// True where repeats agree so much better than stated that most of the noise must be constant at a stop.
  bool mostly_constant_at_stops() const;
  /// True where a share of outliers is above 0.3 % and above what chance makes of so few readings, or where
  /// one reading lies so far off that of a thousand such recordings one would hold it.
  bool suspicious() const;
};

/// Distances and directions are those of the calibration's landmarks and stops (commanded stops where it has
/// none); for pairs the true distances. Zero readings where the calibration has no curve. Cost: linear in the
/// readings.
ResidualCheck check_residuals(std::span<const Recording> recordings, const Calibration& calibration);

}  // namespace rangecal
