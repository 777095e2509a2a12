// SPDX-License-Identifier: BSD-3-Clause
// Departures that no catalogue names: they have a place and a size, and must be given no name.
#include <cmath>

#include "plant_entry.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

void cable_guard(World& world, double size, Random& random) {
  UncataloguedEffects& odd = world.uncatalogued;
  odd.guard_m = size;
  odd.guard_half_width_rad = random.uniform(0.3, 0.5);
  odd.guard_direction_rad = sector_direction(world, odd.guard_half_width_rad, 0.1, 0.4, random);
  world.truth["cable_guard.height_m"] = size;
  world.truth["cable_guard.direction_rad"] = odd.guard_direction_rad;
  world.truth["cable_guard.half_width_rad"] = odd.guard_half_width_rad;
}

void mains_flicker(World& world, double size, Random& random) {
  world.uncatalogued.flicker_m = size;
  world.uncatalogued.flicker_period_s = run_length_s(world) * random.uniform(0.2, 0.4);
  world.uncatalogued.flicker_phase_rad = any_angle(random);
  world.truth["mains_flicker.amplitude_m"] = size;
  world.truth["mains_flicker.period_s"] = world.uncatalogued.flicker_period_s;
}

void stick_slip_mount(World& world, double size, Random& random) {
  world.uncatalogued.stick_rad = size;
  world.uncatalogued.stick_step_k = world.thermal.rise_k * random.uniform(0.25, 0.4);
  world.truth["stick_slip_mount.step_rad"] = size;
  world.truth["stick_slip_mount.step_k"] = world.uncatalogued.stick_step_k;
}

void dim_return(World& world, double size, Random& random) {
  world.uncatalogued.dim_m = size;
  world.uncatalogued.dim_threshold = quantile(overview(world).intensity, random.uniform(0.4, 0.6));
  world.truth["dim_return.amplitude_m"] = size;
  world.truth["dim_return.threshold"] = world.uncatalogued.dim_threshold;
}

void second_reflection(World& world, double size, Random& random) {
  world.uncatalogued.ghost_m = size;
  world.uncatalogued.ghost_at_m = quantile(overview(world).distance_m, random.uniform(0.25, 0.75));
  world.uncatalogued.ghost_width_m = random.uniform(0.12, 0.25);
  world.truth["second_reflection.height_m"] = size;
  world.truth["second_reflection.distance_m"] = world.uncatalogued.ghost_at_m;
  world.truth["second_reflection.width_m"] = world.uncatalogued.ghost_width_m;
}

void motor_detents(World& world, double size, Random&) {
  world.uncatalogued.detent_rad = size;
  world.truth["motor_detents.amplitude_rad"] = size;
}

void trefoil(World& world, double size, Random& random) {
  world.uncatalogued.trefoil_m = size;
  world.uncatalogued.trefoil_phase_rad = any_angle(random);
  world.truth["trefoil.amplitude_m"] = std::abs(size);
}

void knock(World& world, double size, Random& random) {
  world.uncatalogued.knock_m = size;
  world.uncatalogued.knock_time_s = run_length_s(world) * random.uniform(0.3, 0.7);
  world.truth["knock.step_m"] = size;
  world.truth["knock.time_s"] = world.uncatalogued.knock_time_s;
}

void noise_burst(World& world, double size, Random& random) {
  const double run = run_length_s(world), length = random.uniform(0.15, 0.3);
  world.uncatalogued.burst_factor = size;
  world.uncatalogued.burst_from_s = run * random.uniform(0.1, 0.9 - length);
  world.uncatalogued.burst_to_s = world.uncatalogued.burst_from_s + run * length;
  world.truth["noise_burst.spread_factor"] = 1.0 + size;
  world.truth["noise_burst.from_s"] = world.uncatalogued.burst_from_s;
  world.truth["noise_burst.to_s"] = world.uncatalogued.burst_to_s;
}

}  // namespace

std::vector<PlantEntry> outside_plants() {
  const std::vector<std::string> r{"range"}, b{"bearing"};
  return {
      {{"cable_guard",
        "m",
        0.02,
        0.1,
        mean,
        r,
        {"sensor_bearing"},
        false,
        "a bowed guard in front of part of the window"},
       cable_guard},
      {{"mains_flicker",
        "m",
        0.01,
        0.05,
        mean,
        r,
        {"time", "stop"},
        false,
        "slow beat of mains light with the exposure"},
       mains_flicker},
      {{"stick_slip_mount",
        "rad per step",
        0.00873,
        0.0524,
        mean,
        b,
        {"temperature_c", "time", "stop"},
        false,
        "the mount turns in steps as it warms"},
       stick_slip_mount},
      {{"dim_return",
        "m",
        0.02,
        0.1,
        mean,
        r,
        {"intensity", "range", "landmark"},
        false,
        "range of dim returns is off beyond a threshold"},
       dim_return},
      {{"second_reflection",
        "m",
        0.02,
        0.1,
        mean,
        r,
        {"range", "disparity"},
        false,
        "a second reflection around one distance"},
       second_reflection},
      {{"motor_detents", "rad", 0.01, 0.06, mean, b, {"sensor_bearing"}, false, "eight detents a turn"},
       motor_detents},
      {{"trefoil", "m", 0.01, 0.05, mean, r, {"sensor_bearing"}, false, "the ring is a trefoil"}, trefoil},
      {{"knock", "m", 0.01, 0.05, mean, r, {"time", "stop"}, false, "a knock moves the range zero"}, knock},
      {{"noise_burst",
        "sd factor - 1",
        1.0,
        5.0,
        noise,
        {"range_noise"},
        {"time", "stop"},
        false,
        "noise for a part of the run"},
       noise_burst},
  };
}

}  // namespace rangecal::world
