// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/core/recording.hpp"

namespace rangecal::testing {

/// One reading of a recording made by hand: ten seconds a stop, one a repeat, rows counted as in a file.
inline void add_reading(Recording& recording, int stop, int landmark, int repeat, double range_m, double bearing_rad) {
  Readings& r = recording.readings;
  r.stop.push_back(stop), r.landmark.push_back(landmark), r.repeat.push_back(repeat);
  r.range_m.push_back(range_m);
  r.bearing_rad.push_back(bearing_rad);
  r.time_s.push_back(10.0 * stop + repeat);
  r.row.push_back(static_cast<int>(r.row.size()) + 2);
}

}  // namespace rangecal::testing
