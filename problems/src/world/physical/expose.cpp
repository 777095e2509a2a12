// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <numbers>

#include "noise_budget.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/problems/world/physical/cylinder_geometry.hpp"
#include "rangecal/problems/world/physical/optical_sensor.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/problems/world/physical/spinning_head.hpp"

namespace rangecal::world {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;

double stop_time_s(const World& world, int stop) { return stop * stop_period_s(world); }

double ambient_ratio(const AmbientLight& ambient, double beam_rad) {
  if (!(ambient.ratio > 0.0)) return 0.0;
  return std::abs(wrap_angle(beam_rad - ambient.direction_rad)) <= ambient.half_width_rad ? ambient.ratio
                                                                                          : 0.0;
}

double odd_range_m(const UncataloguedEffects& odd, double distance_m, double beam_rad, double time_s,
                   double intensity) {
  double error = 0.0;
  if (odd.guard_m != 0.0) {
    const double off = std::abs(wrap_angle(beam_rad - odd.guard_direction_rad)) / odd.guard_half_width_rad;
    if (off < 1.0) error += odd.guard_m * std::sqrt(1.0 - off * off * off * off);  // bowed guard
  }
  if (odd.flicker_m != 0.0)
    error += odd.flicker_m * std::sin(kTurn * time_s / odd.flicker_period_s + odd.flicker_phase_rad);
  if (odd.dim_m != 0.0 && intensity < odd.dim_threshold)
    error += odd.dim_m * std::sqrt(1.0 - intensity / odd.dim_threshold);
  if (odd.ghost_m != 0.0) {
    const double off = (distance_m - odd.ghost_at_m) / odd.ghost_width_m;
    error += odd.ghost_m * std::exp(-0.5 * off * off);
  }
  if (odd.trefoil_m != 0.0) error += odd.trefoil_m * std::cos(3.0 * beam_rad - odd.trefoil_phase_rad);
  if (odd.knock_m != 0.0 && time_s >= odd.knock_time_s) error += odd.knock_m;
  return error;
}

double odd_bearing_rad(const UncataloguedEffects& odd, double beam_rad, double rise_k) {
  double error = 0.0;
  if (odd.detent_rad != 0.0)
    error += odd.detent_rad * (std::abs(std::sin(4.0 * beam_rad)) - 2.0 / std::numbers::pi);
  if (odd.stick_rad != 0.0) error += odd.stick_rad * std::floor(rise_k / odd.stick_step_k);
  return error;
}

Exposure expose_one(const World& world, const Pose2& robot_stop, int stop, int landmark, int repeat) {
  const Cylinder& cylinder = world.landmarks[static_cast<std::size_t>(landmark)];
  const double period = world.head.sweep_period_s;
  const double middle = world.timing.wait_s + (repeat + 0.5) * period, start = stop_time_s(world, stop);
  Exposure out;
  out.stop = stop, out.landmark = landmark, out.repeat = repeat;

  // The beam's moment in the sweep depends on its direction, and its direction on the pose at that moment.
  Sight sight;
  double in_sweep = 0.0;
  const int iterations = world.robot.creep_mps != 0.0 || world.robot.creep_radps != 0.0 ? 4 : 2;
  for (int i = 0; i < iterations; ++i) {
    out.time_s = start + middle + in_sweep;
    const Pose2 pose = sensor_pose(world, robot_stop, out.time_s, middle + in_sweep, in_sweep);
    sight = look_at(world.head, cylinder, pose, out.time_s);
    in_sweep = period * wrap_angle(sight.head_rad) / kTurn;
  }
  const double beam = sight.head_rad;
  const ThermalState base = thermal_state(world.thermal, out.time_s);
  const double ambient = ambient_ratio(world.ambient, beam);

  out.distance_m = sight.distance_m + cover_path_m(world.head, beam) + cylinder.penetration_m;
  out.half_width_rad = sight.half_width_rad;
  out.temperature_c = base.temperature_c;
  const double reflectance =
      cylinder.dark_reflectance > 0.0 ? cylinder.dark_reflectance : cylinder.reflectance;
  out.intensity = 100.0 * reflectance / (out.distance_m * out.distance_m);
  out.centroid_mm =
      centroid_mm(world.sensor, world.ambient, base, with_crosstalk_m(world.sensor, out.distance_m), ambient,
                  cylinder.spot_skew_px);
  out.thermal_zero_m = base.zero_m;
  out.offset_m = odd_range_m(world.uncatalogued, out.distance_m, beam, out.time_s, out.intensity);
  OpticalSensor fine = world.sensor;
  fine.centroid_step_px = fine.output_lsb_m = 0.0;
  out.range_m = firmware_range_m(fine, out.centroid_mm, out.distance_m, out.thermal_zero_m) + out.offset_m;
  out.range_sd_m = range_sd_m(world, cylinder, out.distance_m, out.range_m, ambient, out.time_s);
  out.bearing_rad =
      wrap_angle(encoder_reading_rad(world.head, beam, out.time_s) +
                 odd_bearing_rad(world.uncatalogued, beam, base.temperature_c - world.thermal.start_c));
  return out;
}

}  // namespace

double stop_period_s(const World& world) {
  return world.timing.drive_s + world.timing.wait_s + world.timing.repeats * world.head.sweep_period_s;
}

double run_length_s(const World& world) {
  const int last = static_cast<int>(world.robot.stops.size()) - 1;
  return stop_time_s(world, last < 0 ? 0 : last);
}

std::vector<Exposure> expose(const World& world, const std::vector<Pose2>& robot_stops) {
  std::vector<Exposure> out;
  const int landmarks = static_cast<int>(world.landmarks.size());
  out.reserve(robot_stops.size() * world.landmarks.size() * static_cast<std::size_t>(world.timing.repeats));
  for (int k = 0; k < static_cast<int>(robot_stops.size()); ++k)
    for (int l = 0; l < landmarks; ++l)
      for (int r = 0; r < world.timing.repeats; ++r)
        out.push_back(expose_one(world, robot_stops[static_cast<std::size_t>(k)], k, l, r));
  return out;
}

double range_output_m(const World& world, const Exposure& exposure, double noise_m) {
  const OpticalSensor& sensor = world.sensor;
  const double product_mm = sensor.nominal_fs_mm_sq();  // f s [mm^2]
  const double x = exposure.centroid_mm, noise_mm = 1e3 * noise_m;
  // Noise on the centroid before 1/x, or the centroid that gives exactly the range with the noise added.
  const double noisy_x = world.noise.before_inversion ? x - noise_mm * x * x / product_mm
                                                      : product_mm / (product_mm / x + noise_mm);
  return firmware_range_m(sensor, noisy_x, exposure.distance_m, exposure.thermal_zero_m) + exposure.offset_m;
}

}  // namespace rangecal::world
