// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/simulate.hpp"

#include <cmath>
#include <numbers>

#include "noise_budget.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/spinning_head.hpp"

namespace rangecal::world {
namespace {

Recording empty_recording(const World& world) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.sensor = {"spinning-triangulation-lidar", "triangulation", 0.05, 12.0};
  recording.sigma_xy_m = world.robot.stated_sigma_m;
  recording.sigma_heading_rad = world.robot.stated_heading_sigma_rad;
  recording.stops = world.robot.stops;
  for (const Cylinder& cylinder : world.landmarks)
    recording.landmarks.push_back({cylinder.label, cylinder.nominal_radius_m, std::nullopt});
  return recording;
}

int reported_label(const Driver& driver, int stop, int landmark) {
  for (const LabelSwap& swap : driver.swaps) {
    if (swap.stop != stop) continue;
    if (swap.a == landmark) return swap.b;
    if (swap.b == landmark) return swap.a;
  }
  return landmark;
}

/// The random part of every reading; one stream for each kind.
struct Streams {
  Random range, bearing, tail, cell, intensity, temperature;
  explicit Streams(std::uint64_t seed)
      : range(seed_from("world.range", {seed})),
        bearing(seed_from("world.bearing", {seed})),
        tail(seed_from("world.tail", {seed})),
        cell(seed_from("world.cell", {seed})),
        intensity(seed_from("world.intensity", {seed})),
        temperature(seed_from("world.temperature", {seed})) {}
};

double tail_error_m(const World& world, const Exposure& exposure, Random& random) {
  const double chance = random.uniform(), where = random.uniform(-1.0, 1.0);
  const Cylinder& cylinder = world.landmarks[static_cast<std::size_t>(exposure.landmark)];
  if (world.noise.spot_radius_m > 0.0)
    return clipped_shift_m(world, cylinder, exposure.distance_m, where * cylinder.radius_m);
  const Tail tail = tail_of(world, cylinder, exposure);
  return chance < tail.share ? 0.5 * (tail.low_m + tail.high_m + where * (tail.high_m - tail.low_m)) : 0.0;
}

void add_reading(Recording& recording, const World& world, const Exposure& exposure, double range_m,
                 double bearing_rad, Streams& streams) {
  const double glow = 1.0 + 0.03 * streams.intensity.normal();
  const double thermometer = 0.05 * streams.temperature.normal();
  ++recording.counts.read;
  const bool lost = world.driver.far_limit_m > 0.0 && range_m > world.driver.far_limit_m;
  if (lost || !(range_m > recording.sensor.range_min_m && range_m < recording.sensor.range_max_m)) return;
  Readings& readings = recording.readings;
  readings.stop.push_back(exposure.stop);
  readings.landmark.push_back(reported_label(world.driver, exposure.stop, exposure.landmark));
  readings.repeat.push_back(exposure.repeat);
  readings.time_s.push_back(exposure.time_s);
  readings.range_m.push_back(range_m);
  readings.bearing_rad.push_back(bearing_rad);
  readings.row.push_back(static_cast<int>(readings.size()) + 1);
  if (world.driver.intensity) readings.covariates["intensity"].push_back(exposure.intensity * glow);
  if (world.driver.temperature)
    readings.covariates["temperature_c"].push_back(exposure.temperature_c + thermometer);
}

}  // namespace

Placing placing_of(const World& world, std::uint64_t seed) {
  Random random(seed_from("world.placing", {seed}));
  return draw_placing(world, random);
}

Recording simulate(const World& world, std::uint64_t seed) {
  Recording recording = empty_recording(world);
  Streams streams(seed);
  const std::vector<Pose2> stops = true_stops(world, placing_of(world, seed));
  const NoiseBudget& noise = world.noise;
  const double renew = std::sqrt(1.0 - noise.smoothing * noise.smoothing);
  double shared_m = 0.0, filtered = 0.0;
  for (const Exposure& exposure : expose(world, stops)) {
    const double fresh = streams.range.normal();
    if (exposure.repeat == 0) {
      shared_m = noise.cell_sd_m * streams.cell.normal();
      filtered = fresh;
    } else {
      filtered = noise.smoothing * filtered + renew * fresh;
    }
    const double noise_m =
        exposure.range_sd_m * filtered + shared_m + tail_error_m(world, exposure, streams.tail);
    const double edge = std::numbers::sqrt2 * noise.sigma_theta_rad;
    const double low = edge * streams.bearing.normal(), high = edge * streams.bearing.normal();
    add_reading(recording, world, exposure, range_output_m(world, exposure, noise_m),
                centre_of_hits_rad(world.head, exposure.bearing_rad, exposure.half_width_rad, low, high),
                streams);
  }
  recording.counts.used = static_cast<int>(recording.readings.size());
  // The device wrote what it saw; readings it did not see are missing from the file, not dropped by a reader.
  recording.counts.read = recording.counts.used;
  Random tape(seed_from("world.tape", {seed}));
  for (const Tape& taped : world.tapes) {
    const Cylinder& a = world.landmarks.at(static_cast<std::size_t>(taped.from));
    const Cylinder& b = world.landmarks.at(static_cast<std::size_t>(taped.to));
    const double distance = std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) + taped.sigma_m * tape.normal();
    recording.known_distances.push_back({taped.from, taped.to, distance, taped.sigma_m});
  }
  const Expected truth = expected(world, placing_of(world, seed));
  for (const Pose2& stop : truth.stops) recording.truth.stops.emplace_back(stop);
  for (const Eigen::Vector2d& position : truth.landmark_positions_m)
    recording.truth.landmarks.emplace_back(position);
  return recording;
}

}  // namespace rangecal::world
