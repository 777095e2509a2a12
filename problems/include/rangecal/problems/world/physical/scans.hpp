// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "rangecal/core/scan.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// A flat wall from one point to another [m], in the world.
struct Wall {
  double x0_m = 0.0, y0_m = 0.0, x1_m = 0.0, y1_m = 0.0;
};

/// What full scans hold besides the landmarks.
struct ScanScene {
  std::vector<Wall> walls;
  double first_beam_rad = -3.141592653589793, step_rad = 0.017453292519943295;
  int beams = 360;
  double spot_radius_m = 0.0;  ///< beams within this of an edge read a mixture of front and back
  double lost_share = 0.0;     ///< share of beams that do not return, at random
  int moving_scans = 0;        ///< scans on the way from each stop to the next, without a label
  bool label_stops = true;     ///< scans at a stop carry its label
};

/// What the beams of one scan really hit.
struct ScanTruth {
  Pose2 sensor;             ///< true pose
  int stop = -1;            ///< -1 on the way
  std::vector<int> target;  ///< per beam: landmark, -1 wall, -2 nothing
};

struct SimulatedScans {
  ScanLog log;
  std::vector<ScanTruth> truth;
};

/// Scans of a world: every beam is cut with every landmark's surface (see cylinder_geometry.hpp) and every wall, the
/// nearest goes through detector and firmware as in simulate(), noise is N(0, spread(r)) of the world's budget at
/// reflectance 0.7. Timing and placing are those of simulate(world, seed); random numbers are streams of their own.
SimulatedScans simulate_scans(const World& world, const ScanScene& scene, std::uint64_t seed);

}  // namespace rangecal::world
