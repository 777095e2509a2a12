// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// Random errors of one run, per stop.
struct Placing {
  std::vector<Pose2> error;  ///< added to where the wheels led
};
Placing no_placing_error(const World& world);
Placing draw_placing(const World& world, Random& random);

/// Where the robot really is at each stop: wheel odometry of the commanded path (turn, drive, turn) with the
/// true wheels, plus slip, plus placing errors. Heading drift, swing and creep belong to the reading, not to
/// this.
std::vector<Pose2> true_stops(const World& world, const Placing& placing);

/// Pose of the sensor at a moment: `since_stop_s` after the stop, `in_sweep_s` from the middle of the sweep.
Pose2 sensor_pose(const World& world, const Pose2& robot, double time_s, double since_stop_s,
                  double in_sweep_s);

}  // namespace rangecal::world
