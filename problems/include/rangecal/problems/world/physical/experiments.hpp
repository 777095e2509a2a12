// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string_view>
#include <vector>

#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// One change of the experiment.
struct Experiment {
  const char* code;    ///< E1 ... E12, as in the catalogue's menu
  const char* change;  ///< in words
};

/// The changes that carry_out knows.
const std::vector<Experiment>& experiments();

/// The same world, with what was planted in it, recorded by an extended experiment:
///   E1 the sensor turned to 0, 90, 180, 270 degrees at each stop   E2 the stops once more in reverse order
///   E3 the distance between the two landmarks farthest apart taped  E4 landmarks of 4, 8 and 12 cm in turn
///   E7 200 sweeps at each stop                                      E8 five stops 5 mm apart after the
///   middle one E9 two more landmarks, one at 0.4 m of the path, one far        E10 lights off E11 twice the
///   wait at each stop before reading, at rest         E12 read when the sensor is warm
/// Throws InputError for another code.
World carry_out(const World& world, std::string_view code);

}  // namespace rangecal::world
