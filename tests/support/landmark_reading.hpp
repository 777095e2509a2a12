// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

namespace rangecal::testing {

/// Reading i of a recording, as it comes in a stream.
inline LandmarkReading reading_of(const Recording& recording, std::size_t i) {
  const Readings& r = recording.readings;
  const Landmark& landmark = recording.landmarks[static_cast<std::size_t>(r.landmark[i])];
  return {recording.stops[static_cast<std::size_t>(r.stop[i])], landmark.label, landmark.radius_m,
          r.range_m[i], r.bearing_rad[i]};
}

}  // namespace rangecal::testing
