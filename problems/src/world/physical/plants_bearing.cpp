// SPDX-License-Identifier: BSD-3-Clause
// Departures of the turning head: B1 to B7 of the catalogue.
#include <algorithm>
#include <cmath>
#include <map>

#include "plant_entry.hpp"
#include "rangecal/problems/world/physical/spinning_head.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

void bearing_offset(World& world, double size, Random&) {
  world.head.zero_rad += size;
  world.truth["bearing_offset.angle_rad"] = size;
}

void bearing_drift(World& world, double size, Random&) {
  world.head.zero_creep_rad_per_s += size / run_length_s(world);
  world.truth["bearing_drift.angle_rad"] = size;  // over the run
}

void beam_offset(World& world, double size, Random&) {
  constexpr double aligned_at_m = 2.0;
  world.head.beam_offset_m = size;
  world.head.beam_squint_rad = std::asin(size / aligned_at_m);
  world.truth["beam_offset.offset_m"] = size;
  world.truth["beam_offset.squint_rad"] = world.head.beam_squint_rad;
}

void encoder_eccentricity(World& world, double size, Random& random) {
  world.head.disc_offset_mm = size * world.head.encoder_radius_mm;
  world.head.disc_phase_rad = any_angle(random);
  world.truth["encoder_eccentricity.amplitude_rad"] = std::abs(size);
  world.truth["encoder_eccentricity.sin_rad"] = size * std::cos(world.head.disc_phase_rad);
  world.truth["encoder_eccentricity.cos_rad"] = -size * std::sin(world.head.disc_phase_rad);
}

void encoder_ellipticity(World& world, double size, Random& random) {
  world.head.ring_stretch = 2.0 * size;
  world.head.ring_phase_rad = any_angle(random);
  world.truth["encoder_ellipticity.amplitude_rad"] = std::abs(size);
  world.truth["encoder_ellipticity.sin_rad"] = size * std::cos(2.0 * world.head.ring_phase_rad);
  world.truth["encoder_ellipticity.cos_rad"] = -size * std::sin(2.0 * world.head.ring_phase_rad);
}

void bearing_scale(World& world, double size, Random&) {
  world.head.gear_error += size;
  world.truth["bearing_scale.scale"] = size;
}

void bearing_quantisation(World& world, double size, Random& random) {
  world.head.beam_grid_rad = size;
  world.head.beam_grid_phase_rad = size * random.uniform();
  world.truth["bearing_quantisation.step_rad"] = 0.5 * size;  // of the bearings: middles of two beams
}

void sweep_motion(World& world, double size, Random&) {
  world.robot.creep_mps = size;
  world.truth["sweep_motion.speed_mps"] = size;
  world.truth["sweep_motion.period_s"] = world.head.sweep_period_s;
}

/// How far the head is still turned at a stop's first reading, on average over the stops.
double first_yaw_rad(const World& world) {
  World still = world;  // what the swing shifts the moments by is of second order in the size
  still.head.swing_rad = 0.0;
  still.timing.repeats = 1;
  std::map<int, double> first_s;  // since the robot stopped, by stop
  for (const Exposure& exposure : first_exposures(still)) {
    const double since = exposure.time_s - exposure.stop * stop_period_s(still);
    const auto [at, added] = first_s.try_emplace(exposure.stop, since);
    if (!added) at->second = std::min(at->second, since);
  }
  double sum = 0.0;
  for (const auto& [stop, since] : first_s) sum += swing_rad(world.head, since);
  return first_s.empty() ? 0.0 : sum / static_cast<double>(first_s.size());
}

void settling(World& world, double size, Random& random) {
  world.head.swing_rad = size;
  world.head.swing_time_s = random.uniform(0.3, 1.0);
  world.truth["settling.amplitude_rad"] = first_yaw_rad(world);
  world.truth["settling.time_s"] = world.head.swing_time_s;
}

}  // namespace

std::vector<PlantEntry> bearing_plants() {
  const std::vector<std::string> b{"bearing"};
  return {
      {{"bearing_offset", "rad", 0.01745, 0.0873, mean, b, {"constant"}, true, "encoder zero off"},
       bearing_offset},
      {{"bearing_drift",
        "rad per run",
        0.00873,
        0.0873,
        mean,
        b,
        {"time", "stop", "temperature_c"},
        true,
        "encoder zero creeps"},
       bearing_drift},
      {{"beam_offset",
        "m",
        0.022,
        0.04,
        mean,
        b,
        {"disparity", "range"},
        true,
        "beam passes beside the spin axis"},
       beam_offset},
      {{"encoder_eccentricity",
        "rad",
        0.00244,
        0.0524,
        mean,
        b,
        {"sensor_bearing"},
        true,
        "disc centre off the spin axis"},
       encoder_eccentricity},
      {{"encoder_ellipticity",
        "rad",
        0.00524,
        0.035,
        mean,
        b,
        {"sensor_bearing"},
        true,
        "graduation ring stretched"},
       encoder_ellipticity},
      {{"bearing_scale",
        "1",
        0.005,
        0.03,
        mean,
        b,
        {"sensor_bearing"},
        true,
        "angle counted too fast since the index pulse"},
       bearing_scale},
      {{"bearing_quantisation",
        "rad",
        0.01745,
        0.0524,
        grid,
        {"grid", "bearing_dependence", "bearing"},
        {"sensor_bearing", "any"},
        true,
        "beams on a grid, centre of first and last hit"},
       bearing_quantisation},
      {{"sweep_motion",
        "m/s",
        0.3,
        1.0,
        mean,
        {"range", "bearing"},
        {"sensor_bearing"},
        true,
        "the robot rolls during each sweep"},
       sweep_motion},
      {{"settling",
        "rad",
        0.01745,
        0.1745,
        mean,
        b,
        {"repeat", "time"},
        true,
        "the head still swings when the robot stops"},
       settling},
  };
}

}  // namespace rangecal::world
