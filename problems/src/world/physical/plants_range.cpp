// SPDX-License-Identifier: BSD-3-Clause
// Departures of the range sensor and of the surfaces it sees: R1 to R17 of the catalogue.
#include <algorithm>
#include <cmath>
#include <numbers>

#include "plant_entry.hpp"
#include "rangecal/problems/world/physical/cylinder_geometry.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

double fs_mm_sq(const OpticalSensor& sensor) { return sensor.nominal_focal_mm * sensor.nominal_baseline_mm; }

void range_offset(World& world, double size, Random&) {
  world.sensor.range_zero_m += size;
  world.truth["range_offset.offset_m"] = size;
}

/// Mean depth of parallel beams over the inner share h of a circle, in radii: 1 - (h sqrt(1-h^2) + asin h) /
/// (2h).
double mean_depth(double h) { return 1.0 - (h * std::sqrt(1.0 - h * h) + std::asin(h)) / (2.0 * h); }

void arc_definition(World& world, double size, Random&) {
  double low = 1e-6, high = 1.0;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (mean_depth(middle) < size ? low : high) = middle;
  }
  world.head.mean_of_hits = size > 0.0;
  world.head.hit_share = high;
  world.truth["arc_definition.kappa"] = size;
}

void radius_scale(World& world, double size, Random&) {
  for (Cylinder& landmark : world.landmarks) landmark.radius_m *= 1.0 + size;
  world.truth["radius_scale.scale"] = size;
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
  const double fs = fs_mm_sq(world.sensor);
  world.truth["lens_distortion.k1_per_mm2"] = size;
  world.truth["lens_distortion.inverse_m2"] = -1e-6 * size * fs * fs;  // dr = this / d
}

void pixel_locking(World& world, double size, Random&) {
  // A spot of sigma w px summed over whole pixels is pulled by (1/pi) exp(-2 pi^2 w^2) px (first harmonic).
  const double pi = std::numbers::pi;
  const double amplitude = std::max(size, 1e-9);
  world.sensor.spot_sigma_px = std::sqrt(std::max(1e-4, -std::log(pi * amplitude) / (2.0 * pi * pi)));
  world.truth["pixel_locking.amplitude_px"] = size;
  world.truth["pixel_locking.period_per_m"] = 1e3 * world.sensor.pitch_mm / fs_mm_sq(world.sensor);  // in 1/d
  world.truth["pixel_locking.amplitude_per_m"] = size * 1e3 * world.sensor.pitch_mm / fs_mm_sq(world.sensor);
}

void quantisation(World& world, double size, Random&) {
  world.sensor.centroid_step_px = size;
  world.truth["quantisation.step_px"] = size;
  world.truth["quantisation.disparity_step_per_m"] =
      1e3 * size * world.sensor.pitch_mm / fs_mm_sq(world.sensor);
}

void near_regime(World& world, double size, Random& random) {
  world.sensor.near_below_m = quantile(overview(world).distance_m, random.uniform(0.15, 0.35));
  world.sensor.near_offset_m = size;
  world.truth["near_regime.limit_m"] = world.sensor.near_below_m;
  world.truth["near_regime.offset_m"] = size;
}

void target_reflectance(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  const bool penetrates = random.uniform() < 0.5;
  if (penetrates) {
    world.landmarks[l].penetration_m += size;
  } else {  // a skewed spot: dr = -(d^2 / fs) dx, `size` at 1.5 m
    world.landmarks[l].spot_skew_px -=
        1e-3 * size / (1.5 * 1.5) * fs_mm_sq(world.sensor) / world.sensor.pitch_mm;
  }
  world.truth["target_reflectance.landmark"] = static_cast<double>(l);
  world.truth["target_reflectance.power"] = penetrates ? 0.0 : 2.0;
  world.truth["target_reflectance.amplitude_m"] =
      penetrates ? size : size / (1.5 * 1.5);  // times (d / 1 m)^power
}

void dark_target(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  world.landmarks[l].dark_reflectance = world.landmarks[l].reflectance / ((1.0 + size) * (1.0 + size));
  world.truth["dark_target.landmark"] = static_cast<double>(l);
  world.truth["dark_target.spread_factor"] = 1.0 + size;
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

void mixed_pixels(World& world, double size, Random&) {
  world.noise.spot_radius_m = size;
  world.truth["mixed_pixels.spot_radius_m"] = size;
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

void landmark_shape(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  world.landmarks[l].out_of_round = size;
  world.landmarks[l].long_axis_rad = any_angle(random);
  world.truth["landmark_shape.landmark"] = static_cast<double>(l);
  world.truth["landmark_shape.out_of_round"] = size;
  world.truth["landmark_shape.axis_rad"] = world.landmarks[l].long_axis_rad;
}

void cyclic_error(World& world, double size, Random& random) {
  world.sensor.modulation_length_m = random.uniform(0.4, 1.2);
  world.sensor.crosstalk_phase_rad = any_angle(random);
  world.sensor.crosstalk = 2.0 * std::numbers::pi * size / world.sensor.modulation_length_m;
  world.truth["cyclic_error.amplitude_m"] = std::abs(size);
  world.truth["cyclic_error.wavelength_m"] = world.sensor.modulation_length_m;
}

void landmark_radius(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  world.landmarks[l].radius_m += size;
  world.truth["landmark_radius.landmark"] = static_cast<double>(l);
  world.truth["landmark_radius.error_m"] = size;
}

}  // namespace

std::vector<PlantEntry> range_plants() {
  const std::vector<std::string> r{"range"}, rn{"range_noise"};
  return {
      {{"range_offset", "m", 0.005, 0.03, absorbed, r, {"constant"}, true, "the firmware's zero is off"},
       range_offset},
      {{"arc_definition",
        "kappa",
        0.2,
        0.2146,
        mean,
        r,
        {"radius"},
        true,
        "mean of the hits instead of the nearest point"},
       arc_definition},
      {{"radius_scale", "1", 0.05, 0.2, mean, r, {"radius"}, true, "all radii are larger than stated"},
       radius_scale},
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
      {{"target_reflectance",
        "m",
        0.015,
        0.06,
        mean,
        r,
        {"landmark"},
        true,
        "light enters one surface, or its spot is skewed"},
       target_reflectance},
      {{"dark_target",
        "sd factor - 1",
        1.0,
        4.0,
        noise,
        rn,
        {"landmark", "intensity"},
        true,
        "one landmark returns less light"},
       dark_target},
      {{"ambient_light", "B/S", 0.5, 5.0, noise, rn, {"sensor_bearing"}, true, "stray light in a sector"},
       ambient_light},
      {{"mixed_pixels",
        "m",
        0.002,
        0.01,
        tail,
        {"range_tail"},
        {"radius", "landmark", "range", "any"},
        true,
        "footprint cut by the landmark's edge"},
       mixed_pixels},
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
      {{"landmark_shape", "1", 0.05, 0.3, mean, r, {"landmark"}, true, "one landmark is out of round"},
       landmark_shape},
      {{"cyclic_error", "m", 0.005, 0.04, mean, r, {"range"}, true, "a leaking phasor in a phase channel"},
       cyclic_error},
      {{"landmark_radius", "m", 0.005, 0.03, mean, r, {"landmark", "radius"}, true, "one radius is wrong"},
       landmark_radius},
  };
}

}  // namespace rangecal::world
