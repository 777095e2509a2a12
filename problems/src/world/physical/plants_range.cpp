// SPDX-License-Identifier: BSD-3-Clause
// Departures of the range sensor: R1, R3 to R8, R10, R12 to R14 and R16 of the catalogue.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "plant_entry.hpp"
#include "rangecal/problems/world/physical/cylinder_geometry.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

void range_offset(World& world, double size, Random&) {
  world.sensor.range_zero_m += size;
  world.truth["range_offset.offset_m"] = size;
}

void range_scale(World& world, double size, Random&) {
  world.sensor.baseline_mm *=
      1.0 - size / (1.0 + size);  // fs smaller by 1/(1 + eps): ranges longer by 1 + eps
  world.truth["range_scale.scale"] = size;
}

void laser_pointing(World& world, double size, Random&) {
  world.sensor.laser_angle_rad += size;
  world.truth["laser_pointing.angle_rad"] = size;
  world.truth["laser_pointing.curvature_per_m"] = size / (1e-3 * world.sensor.baseline_mm);
}

void lens_distortion(World& world, double size, Random&) {
  world.sensor.k1_per_mm2 += size;
  const double fs = world.sensor.nominal_fs_mm_sq();
  world.truth["lens_distortion.k1_per_mm2"] = size;
  world.truth["lens_distortion.inverse_m2"] = -1e-6 * size * fs * fs;  // dr = this / d
}

void pixel_locking(World& world, double size, Random&) {
  // A spot of sigma w px summed over whole pixels is pulled by (1/pi) exp(-2 pi^2 w^2) px (first harmonic).
  const double pi = std::numbers::pi;
  const double amplitude = std::max(size, 1e-9);
  world.sensor.spot_sigma_px = std::sqrt(std::max(1e-4, -std::log(pi * amplitude) / (2.0 * pi * pi)));
  world.truth["pixel_locking.amplitude_px"] = size;
  // A spot at d lies on the pixel f s / (d p), by the true constants.
  const double pixel_per_m = 1e3 * world.sensor.pitch_mm / (world.sensor.focal_mm * world.sensor.baseline_mm);
  world.truth["pixel_locking.period_per_m"] = pixel_per_m;  // in 1/d
  world.truth["pixel_locking.amplitude_per_m"] = size * pixel_per_m;
}

void quantisation(World& world, double size, Random&) {
  world.sensor.centroid_step_px = size;
  world.truth["quantisation.step_px"] = size;
  world.truth["quantisation.disparity_step_per_m"] =
      1e3 * size * world.sensor.pitch_mm / world.sensor.nominal_fs_mm_sq();
}

void near_regime(World& world, double size, Random& random) {
  world.sensor.near_below_m = quantile(overview(world).distance_m, random.uniform(0.15, 0.35));
  world.sensor.near_offset_m = size;
  world.truth["near_regime.limit_m"] = world.sensor.near_below_m;
  world.truth["near_regime.offset_m"] = size;
}

void ambient_light(World& world, double size, Random& random) {
  world.ambient.ratio = size;
  world.ambient.half_width_rad = random.uniform(0.5, 1.0);
  world.ambient.direction_rad = sector_direction(world, world.ambient.half_width_rad, 0.2, 0.6, random);
  const double widths = world.ambient.window_px / world.ambient.spot_px;
  world.truth["ambient_light.ratio"] = size;
  world.truth["ambient_light.direction_rad"] = world.ambient.direction_rad;
  world.truth["ambient_light.half_width_rad"] = world.ambient.half_width_rad;
  world.truth["ambient_light.spread_factor"] = std::sqrt(1.0 + size * widths * widths / 12.0);
}

void tilt(World& world, double size, Random& random) {
  world.head.tilt_rad = size;
  world.head.tilt_axis_rad = any_angle(random);
  world.truth["tilt.angle_rad"] = size;
  world.truth["tilt.axis_rad"] = world.head.tilt_axis_rad;
}

void warmup_drift(World& world, double size, Random& random) {
  const double share = random.uniform();  // of the mount; the rest turns the laser. Together `size` at 2 m.
  world.thermal.time_s = random.uniform(0.2, 0.6) * run_length_s(world);
  world.thermal.zero_m_per_k = share * size / world.thermal.rise_k;
  const double curvature_per_m = (1.0 - share) * size / 4.0;
  world.thermal.pointing_rad_per_k = curvature_per_m * 1e-3 * world.sensor.baseline_mm / world.thermal.rise_k;
  world.truth["warmup_drift.offset_m"] = share * size;
  world.truth["warmup_drift.curvature_per_m"] = curvature_per_m;
  world.truth["warmup_drift.time_s"] = world.thermal.time_s;
}

void range_eccentricity(World& world, double size, Random& random) {
  world.head.cover_offset_m = size;
  world.head.cover_phase_rad = any_angle(random);
  world.truth["range_eccentricity.amplitude_m"] = std::abs(size);
  world.truth["range_eccentricity.cos_m"] = size * std::cos(world.head.cover_phase_rad);
  world.truth["range_eccentricity.sin_m"] = size * std::sin(world.head.cover_phase_rad);
}

void cyclic_error(World& world, double size, Random& random) {
  world.sensor.modulation_length_m = random.uniform(0.4, 1.2);
  world.sensor.crosstalk_phase_rad = any_angle(random);
  world.sensor.crosstalk = 2.0 * std::numbers::pi * size / world.sensor.modulation_length_m;
  world.truth["cyclic_error.amplitude_m"] = std::abs(size);
  world.truth["cyclic_error.wavelength_m"] = world.sensor.modulation_length_m;
}

}  // namespace

std::vector<PlantEntry> range_plants() {
  const std::vector<std::string> r{"range"}, rn{"range_noise"};
  return {
      {{"range_offset", "m", 0.005, 0.03, absorbed, r, {"constant"}, true, "the firmware's zero is off"},
       range_offset},
      {{"range_scale", "1", 0.0015, 0.02, absorbed, r, {"range"}, true, "baseline off"}, range_scale},
      {{"laser_pointing", "rad", 1e-4, 5e-4, absorbed, r, {"range"}, true, "laser turned against the camera"},
       laser_pointing},
      {{"lens_distortion",
        "1/mm^2",
        7.7e-4,
        8e-3,
        mean,
        r,
        {"range", "disparity"},
        true,
        "radial distortion of the lens"},
       lens_distortion},
      {{"pixel_locking",
        "px",
        0.1,
        0.3,
        mean,
        r,
        {"disparity", "range"},
        true,
        "narrow spot, centroid of pixel sums"},
       pixel_locking},
      {{"quantisation",
        "px",
        0.1,
        1.0,
        grid,
        {"grid", "range"},
        {"range", "disparity", "any"},
        true,
        "centroid rounded to a step"},
       quantisation},
      {{"near_regime",
        "m",
        0.005,
        0.05,
        mean,
        r,
        {"range", "disparity"},
        true,
        "near table of the firmware is off"},
       near_regime},
      {{"ambient_light", "B/S", 0.5, 5.0, noise, rn, {"sensor_bearing"}, true, "stray light in a sector"},
       ambient_light},
      {{"tilt",
        "rad",
        0.0873,
        0.2618,
        mean,
        {"range", "bearing"},
        {"sensor_bearing"},
        true,
        "the head leans, rays in three dimensions"},
       tilt},
      {{"warmup_drift",
        "m at 2 m",
        0.01,
        0.06,
        mean,
        r,
        {"time", "temperature_c", "stop"},
        true,
        "mount expands and laser turns while warming"},
       warmup_drift},
      {{"range_eccentricity",
        "m",
        0.0075,
        0.04,
        mean,
        r,
        {"sensor_bearing"},
        true,
        "eccentric ring sets the optical zero"},
       range_eccentricity},
      {{"cyclic_error", "m", 0.005, 0.04, mean, r, {"range"}, true, "a leaking phasor in a phase channel"},
       cyclic_error},
  };
}

}  // namespace rangecal::world
