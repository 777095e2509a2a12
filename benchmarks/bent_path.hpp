// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/scene.hpp"

namespace rangecal {

/// Stops along 6 m that swing to either side by `swing_m`, turning as they go if `turns`, and landmarks of 5 cm on both
/// sides of them in random places.
inline void add_bent_path(Scene& scene, int stops, int landmarks, double swing_m, bool turns,
                          Random& random) {
  for (int k = 0; k < stops; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    const double along = 6.0 * k / stops;
    stop.commanded = {along, swing_m * std::sin(2.0 * along), turns ? along : 0.0};
    scene.stops.push_back(stop);
  }
  for (int l = 0; l < landmarks; ++l) {
    scene.landmarks.push_back({"L" + std::to_string(l), 0.05, {}});
    const double aside = (l % 2 ? -1.0 : 1.0) * random.uniform(1.2, 2.6);
    scene.positions.emplace_back(6.0 * (l + random.uniform(0.2, 0.8)) / landmarks, aside);
  }
}

}  // namespace rangecal
