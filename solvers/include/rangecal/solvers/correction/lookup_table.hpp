// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

namespace rangecal {

/// What a sensor reads at a distance: the mean and the standard deviation of its noise, both in metres.
struct SensorReading {
  double mean_m = 0.0, std_dev_m = 0.0;
};

/// A table between whose rows a simulator interpolates: the mean m and the relative noise n = s / m are linear in d, so that the
/// standard deviation is their product.
struct LookupTable {
  struct Row {
    double distance_m = 0.0, mean_m = 0.0, relative_std_dev = 0.0;
  };
  std::vector<Row> rows;
  double mean_error_m = 0.0, std_dev_error_m = 0.0;  ///< the largest of all places looked at

  /// As the simulator does; the first and last row beyond the ends.
  SensorReading at(double distance_m) const;
};

/// The table of fewest rows that is nowhere further than `tolerance_m` from the sensor, in its mean as in its standard deviation.
///
/// Rows lie on the sensor's curve, at the ends of [low, high] or at one of 999 places between. A pair of these may follow each other if
/// the table is within the tolerance at all places between and midway; the fewest rows are the shortest path over such pairs
/// (breadth first). Where two neighbours of the 1001 differ by more than the tolerance allows, as at a jump, they follow each other all
/// the same: `mean_error_m` says how far the table is off.
/// Throws InputError for a mean that is not positive, and a tolerance or distances that make no sense. Cost: 10^5 to 10^7 steps.
LookupTable fewest_rows(const std::function<SensorReading(double distance_m)>& sensor, double low_m,
                        double high_m, double tolerance_m);

}  // namespace rangecal
