// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "noise_budget.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/problems/world/physical/spinning_head.hpp"

namespace rangecal::world {
namespace {

struct Moments {
  double weight = 0.0, mean = 0.0, sd = 0.0;
};

/// Mean and spread of value(z) over z ~ N(0, 1), where it is finite, by the trapezoid rule over +-6.
template <typename Function>
Moments over_normal(const Function& value) {
  constexpr int half = 120;
  constexpr double step = 0.05;
  double total = 0.0, seen = 0.0, first = 0.0, second = 0.0;
  const double centre = value(0.0), shift = std::isfinite(centre) ? centre : 0.0;
  for (int i = -half; i <= half; ++i) {
    const double z = i * step, weight = std::exp(-0.5 * z * z), v = value(z) - shift;
    total += weight;
    if (!std::isfinite(v)) continue;
    seen += weight, first += weight * v, second += weight * v * v;
  }
  if (seen == 0.0) return {};
  const double mean = first / seen;
  return {seen / total, shift + mean, std::sqrt(std::max(0.0, second / seen - mean * mean))};
}

Moments range_moments(const World& world, const Exposure& exposure) {
  const OpticalSensor& sensor = world.sensor;
  const bool plain = !world.noise.before_inversion && sensor.centroid_step_px == 0.0 &&
                     sensor.output_lsb_m == 0.0 && world.driver.far_limit_m == 0.0;
  if (plain) return {1.0, exposure.range_m, exposure.range_sd_m};
  return over_normal([&](double z) {
    const double range = range_output_m(world, exposure, exposure.range_sd_m * z);
    const bool lost = range <= 0.0 || (world.driver.far_limit_m > 0.0 && range > world.driver.far_limit_m);
    return lost ? std::numeric_limits<double>::quiet_NaN() : range;
  });
}

Moments bearing_moments(const World& world, const Exposure& exposure) {
  const double sigma = world.noise.sigma_theta_rad;
  if (!(world.head.beam_grid_rad > 0.0)) return {1.0, exposure.bearing_rad, sigma};
  // The two edges jitter independently: half the sum of their moments.
  const auto edge = [&](bool low) {
    return over_normal([&](double z) {
      const double error = std::numbers::sqrt2 * sigma * z;
      return wrap_angle(centre_of_hits_rad(world.head, exposure.bearing_rad, exposure.half_width_rad,
                                           low ? error : 0.0, low ? 0.0 : error) -
                        exposure.bearing_rad);
    });
  };
  const double still =
      wrap_angle(centre_of_hits_rad(world.head, exposure.bearing_rad, exposure.half_width_rad, 0.0, 0.0) -
                 exposure.bearing_rad);
  const Moments low = edge(true), high = edge(false);
  return {1.0, wrap_angle(exposure.bearing_rad + low.mean + high.mean - still), std::hypot(low.sd, high.sd)};
}

int reported(const Driver& driver, const Exposure& exposure) {
  for (const LabelSwap& swap : driver.swaps)
    if (swap.stop == exposure.stop) {
      if (swap.a == exposure.landmark) return swap.b;
      if (swap.b == exposure.landmark) return swap.a;
    }
  return exposure.landmark;
}

}  // namespace

Expected expected(const World& world) { return expected(world, no_placing_error(world)); }

Expected expected(const World& world, const Placing& placing) {
  Expected out;
  const std::vector<Pose2> stops = true_stops(world, placing);
  for (const Exposure& exposure : expose(world, stops)) {
    const Moments range = range_moments(world, exposure), bearing = bearing_moments(world, exposure);
    const Tail tail = tail_of(world, world.landmarks[static_cast<std::size_t>(exposure.landmark)], exposure);
    out.stop.push_back(exposure.stop);
    out.landmark.push_back(exposure.landmark);
    out.reported_landmark.push_back(reported(world.driver, exposure));
    out.repeat.push_back(exposure.repeat);
    out.time_s.push_back(exposure.time_s);
    out.distance_m.push_back(exposure.distance_m);
    out.range_mean_m.push_back(range.mean);
    out.range_sd_m.push_back(range.sd);
    out.bearing_mean_rad.push_back(bearing.mean);
    out.bearing_sd_rad.push_back(bearing.sd);
    out.detection.push_back(range.weight);
    out.tail_share.push_back(tail.share);
    out.tail_low_m.push_back(tail.low_m);
    out.tail_high_m.push_back(tail.high_m);
  }
  out.cell_sd_m = world.noise.cell_sd_m;
  out.smoothing = world.noise.smoothing;
  out.placing_sigma_m = world.robot.placing_sigma_m;
  out.walk_sigma_m = world.robot.walk_sigma_m;
  out.heading_sigma_rad = world.robot.heading_sigma_rad;
  out.bearing_grid_rad = 0.5 * world.head.beam_grid_rad;
  const OpticalSensor& sensor = world.sensor;
  out.disparity_step_per_m = 1e3 * sensor.centroid_step_px * sensor.pitch_mm / sensor.nominal_fs_mm_sq();
  out.range_step_m = sensor.output_lsb_m;
  const double to_next = stop_period_s(world);
  const double first = world.timing.wait_s + 0.5 * world.head.sweep_period_s;
  for (std::size_t k = 0; k < stops.size(); ++k) {
    Pose2 pose = sensor_pose(world, stops[k], static_cast<double>(k) * to_next + first, first, 0.0);
    pose.heading_rad = wrap_angle(pose.heading_rad);
    out.stops.push_back(pose);
  }
  for (const Cylinder& cylinder : world.landmarks)
    out.landmark_positions_m.emplace_back(cylinder.x_m, cylinder.y_m);
  return out;
}

}  // namespace rangecal::world
