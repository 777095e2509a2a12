// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "rangecal/core/recording.hpp"

namespace rangecal::testing {

/// Landmarks a, b, c ... of a recording made by hand: poles without a radius.
inline void add_landmarks(Recording& recording, std::size_t count) {
  for (std::size_t l = 0; l < count; ++l) {
    Landmark landmark;
    landmark.label = std::string(1, static_cast<char>('a' + l));
    recording.landmarks.push_back(landmark);
  }
}

/// Its next stop, labelled by its number.
inline void add_stop(Recording& recording, const Pose2& commanded, double sigma_xy_m,
                     std::optional<double> sigma_heading_rad = std::nullopt) {
  Stop stop;
  stop.label = std::to_string(recording.stops.size());
  stop.commanded = commanded;
  stop.sigma_xy_m = sigma_xy_m;
  stop.sigma_heading_rad = sigma_heading_rad;
  recording.stops.push_back(stop);
}

/// One reading of a recording made by hand: ten seconds a stop, one a repeat, rows counted as in a file.
inline void add_reading(Recording& recording, int stop, int landmark, int repeat, double range_m,
                        double bearing_rad) {
  Readings& r = recording.readings;
  r.stop.push_back(stop), r.landmark.push_back(landmark), r.repeat.push_back(repeat);
  r.range_m.push_back(range_m);
  r.bearing_rad.push_back(bearing_rad);
  r.time_s.push_back(10.0 * stop + repeat);
  r.row.push_back(static_cast<int>(r.row.size()) + 2);
}

}  // namespace rangecal::testing
