// SPDX-License-Identifier: BSD-3-Clause
// Departures of the surfaces and of how they are picked: R2, R9, R11, R15, R17 of the catalogue.
#include <cmath>

#include "plant_entry.hpp"
#include "rangecal/problems/world/physical/optical_sensor.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

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

void target_reflectance(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  const bool penetrates = random.uniform() < 0.5;
  if (penetrates) {
    world.landmarks[l].penetration_m += size;
  } else {  // a skewed spot moves the reading r = fs / x by -(r^2 / fs) dx, `size` at 1.5 m
    const double x_mm = centroid_mm(world.sensor, {}, {}, 1.5, 0.0, 0.0);
    world.landmarks[l].spot_skew_px -=
        1e3 * size * x_mm * x_mm / world.sensor.nominal_fs_mm_sq() / world.sensor.pitch_mm;
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

void mixed_pixels(World& world, double size, Random&) {
  world.noise.spot_radius_m = size;
  world.truth["mixed_pixels.spot_radius_m"] = size;
}

void landmark_shape(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  world.landmarks[l].out_of_round = size;
  world.landmarks[l].long_axis_rad = any_angle(random);
  world.truth["landmark_shape.landmark"] = static_cast<double>(l);
  world.truth["landmark_shape.out_of_round"] = size;
  world.truth["landmark_shape.axis_rad"] = world.landmarks[l].long_axis_rad;
}

void landmark_radius(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  world.landmarks[l].radius_m += size;
  world.truth["landmark_radius.landmark"] = static_cast<double>(l);
  world.truth["landmark_radius.error_m"] = size;
}

}  // namespace

std::vector<PlantEntry> surface_plants() {
  const std::vector<std::string> r{"range"}, rn{"range_noise"};
  return {
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
      {{"landmark_shape", "1", 0.05, 0.3, mean, r, {"landmark"}, true, "one landmark is out of round"},
       landmark_shape},
      {{"landmark_radius", "m", 0.005, 0.03, mean, r, {"landmark", "radius"}, true, "one radius is wrong"},
       landmark_radius},
  };
}

}  // namespace rangecal::world
