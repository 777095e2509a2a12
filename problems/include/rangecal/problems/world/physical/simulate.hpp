// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/world/physical/robot_path.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// One reading before its noise: everything that the physics decides.
struct Exposure {
  int stop = 0, landmark = 0, repeat = 0;
  double time_s = 0.0;      ///< of this beam
  double distance_m = 0.0;  ///< along the beam
  double centroid_mm = 0.0;
  double range_m = 0.0;      ///< without noise and rounding
  double bearing_rad = 0.0;  ///< without noise and grid
  double half_width_rad = 0.0;
  double range_sd_m = 0.0;  ///< independent noise
  double intensity = 0.0, temperature_c = 0.0;
  double thermal_zero_m = 0.0, offset_m = 0.0;  ///< added after the centroid
};
/// All readings of a run in the order stop, landmark, repeat, for the given true stops of the robot.
std::vector<Exposure> expose(const World& world, const std::vector<Pose2>& robot_stops);

/// The reading [m] that comes out when the noise at the range is noise_m.
double range_output_m(const World& world, const Exposure& exposure, double noise_m);

/// Means and spreads of every reading, in the order of expose(), with placing errors given.
struct Expected {
  std::vector<int> stop, landmark, reported_landmark, repeat;
  std::vector<double> time_s, distance_m;
  std::vector<double> range_mean_m, range_sd_m;  ///< of a reading that is seen; independent part only
  std::vector<double> bearing_mean_rad, bearing_sd_rad;
  std::vector<double> detection;              ///< probability that the reading is seen
  /// Share of the readings with an extra error, and the ends between which that lies evenly.
  std::vector<double> tail_share, tail_low_m, tail_high_m;
  double cell_sd_m = 0.0;                     ///< shared within a cell
  double smoothing = 0.0;                     ///< AR(1) coefficient over repeats
  double placing_sigma_m = 0.0, walk_sigma_m = 0.0, heading_sigma_rad = 0.0;  ///< of the stops
  double bearing_grid_rad = 0.0;                          ///< step on which bearings sit, 0: none
  double disparity_step_per_m = 0.0, range_step_m = 0.0;  ///< steps on which 1/range and range sit
  std::vector<Pose2> stops;  ///< true poses of the sensor at the first reading of each stop
  std::vector<Eigen::Vector2d> landmark_positions_m;
};
Expected expected(const World& world);  ///< stops where the wheels lead, no random placing
Expected expected(const World& world, const Placing& placing);

/// A recording of this world. Same world and seed: same bits. Each kind of noise has its own stream, so that
/// two worlds with one seed share their draws.
Recording simulate(const World& world, std::uint64_t seed);

/// The placing errors that simulate(world, seed) draws.
Placing placing_of(const World& world, std::uint64_t seed);

}  // namespace rangecal::world
