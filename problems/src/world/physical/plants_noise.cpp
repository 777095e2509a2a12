// SPDX-License-Identifier: BSD-3-Clause
// Departures of the random part: N1 to N6 of the catalogue.
#include <cmath>

#include "plant_entry.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

void noise_law(World& world, double size, Random& random) {
  NoiseBudget& noise = world.noise;
  const OpticalSensor& sensor = world.sensor;
  const double m_per_px = 1e3 * 4.0 * sensor.pitch_mm / (sensor.focal_mm * sensor.baseline_mm);  // at 2 m
  const double wanted_px = size / m_per_px;                                                      // at 2 m
  switch (size > 0.0 ? random.index(3) : 0) {
    case 0:
      noise.floor_m = size;
      world.truth["noise_law.floor_m"] = size;
      break;
    case 1:
      noise.shot_photons = 4.0 * std::pow(noise.spot_px / wanted_px, 2);
      world.truth["noise_law.cubic_per_m2"] = size / 8.0;
      break;
    default:
      noise.shot_photons = 1e10;  // shot noise itself is nil
      noise.background_photons = 12.0 * std::pow(wanted_px * noise.shot_photons / 4.0 / noise.window_px, 2);
      world.truth["noise_law.quartic_per_m3"] = size / 16.0;
  }
}

void cell_effect(World& world, double size, Random&) {
  world.noise.cell_sd_m = size;
  world.truth["cell_effect.sigma_m"] = size;
}

void stop_effect(World& world, double size, Random&) {
  world.robot.placing_sigma_m = std::hypot(world.robot.placing_sigma_m, size);
  world.truth["stop_effect.sigma_m"] = size;
}

void autocorrelated_noise(World& world, double size, Random&) {
  world.noise.smoothing = size;
  world.truth["autocorrelated_noise.rho"] = size;
}

void heavy_tails(World& world, double size, Random&) {
  world.noise.interference_share = size;
  world.truth["heavy_tails.share"] = size;
  world.truth["heavy_tails.ratio"] =
      std::sqrt(1.0 + world.noise.interference_window * world.noise.interference_window / 3.0);
}

void early_echo(World& world, double size, Random&) {
  world.noise.dust_share = size;
  world.truth["early_echo.share"] = size;
}

void late_return(World& world, double size, Random& random) {
  world.noise.grazing_share = size;
  world.noise.wall_behind_m = random.uniform(0.3, 1.5);
  world.truth["late_return.share"] = size;
}

void reciprocal_noise(World& world, double size, Random&) {
  world.noise.before_inversion = true;
  world.noise.speckle_per_m = size;
  world.truth["reciprocal_noise.cv_per_m"] = size;
}

}  // namespace

std::vector<PlantEntry> noise_plants() {
  return {
      {{"noise_law",
        "m at 2 m",
        0.01,
        0.2,
        noise,
        {"range_noise"},
        {"range", "disparity"},
        true,
        "a floor, shot noise or background light"},
       noise_law},
      {{"cell_effect",
        "m",
        0.005,
        0.05,
        dependence,
        {"range_dependence"},
        {"any", "landmark", "stop"},
        true,
        "texture shared by a cell"},
       cell_effect},
      {{"stop_effect",
        "m",
        0.02,
        0.1,
        dependence,
        {"stop", "range_dependence", "bearing_dependence"},
        {"stop", "any"},
        true,
        "stops placed worse than stated"},
       stop_effect},
      {{"autocorrelated_noise",
        "1",
        0.6,
        0.95,
        dependence,
        {"range_dependence"},
        {"repeat", "time", "any"},
        true,
        "readings are smoothed"},
       autocorrelated_noise},
      {{"heavy_tails",
        "1",
        0.03,
        0.2,
        tail,
        {"range_tail"},
        {"any"},
        true,
        "another lidar's spot in the window"},
       heavy_tails},
      {{"early_echo",
        "1",
        0.05,
        0.3,
        tail,
        {"range_tail", "range_noise"},
        {"any", "range"},
        true,
        "dust between sensor and landmark"},
       early_echo},
      {{"late_return",
        "1",
        0.05,
        0.3,
        tail,
        {"range_tail", "range_noise"},
        {"any", "range"},
        true,
        "beams that graze an edge read a mixture with the wall behind"},
       late_return},
      {{"reciprocal_noise",
        "1/m",
        0.02,
        0.05,
        tail,
        {"range_tail", "range"},
        {"range", "any"},
        true,
        "noise on the centroid before 1/x"},
       reciprocal_noise},
  };
}

}  // namespace rangecal::world
