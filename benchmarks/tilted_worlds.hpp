// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <numbers>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"

namespace rangecal::bench {

/// Another unit of the sensor in the physical world, its plane tilted about a random level axis, every
/// cylinder leaning in a direction of its own.
inline world::World tilted_world(bool turning, double tilt_rad, double lean_rad, std::uint64_t repeat,
                                 Random& random) {
  world::World world = vary(turning ? world::make_turning_design() : world::make_line_design(), random);
  world.head.tilt_rad = tilt_rad;
  world.head.tilt_axis_rad = random.uniform(-std::numbers::pi, std::numbers::pi);
  Random directions(seed_from("tilt accuracy, lean", {turning ? 1u : 0u, repeat}));
  for (world::Cylinder& cylinder : world.landmarks) {
    cylinder.lean_rad = lean_rad;
    cylinder.lean_azimuth_rad = directions.uniform(-std::numbers::pi, std::numbers::pi);
  }
  return world;
}

/// Mean square over 0.5 to 4 m of the error in the corrected distance [m^2].
inline double curve_error_sq(const world::OpticalSensor& s, const Calibration& c) {
  double sum = 0.0;
  for (int i = 0; i < 8; ++i) {
    const double d = 0.5 + 0.5 * i;
    const double x_mm = s.focal_mm * s.baseline_mm / (1e3 * d) - s.focal_mm * std::tan(s.laser_angle_rad) +
                        s.detector_shift_mm;
    const double f = 1e-3 * s.nominal_focal_mm * s.nominal_baseline_mm / x_mm + s.range_zero_m;
    sum += std::pow((evaluate_polynomial(c.alpha, d) - f) / evaluate_derivative(c.alpha, d), 2) / 8.0;
  }
  return sum;
}

}  // namespace rangecal::bench
