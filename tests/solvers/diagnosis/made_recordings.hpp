// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/add_reading.hpp"

/// Recordings of sensors with a grid or a depth axis, drawn by hand.
namespace rangecal::testing {

struct Sensor {
  double sigma = 0.0;          ///< of s = sigma f^2 [1/m]
  double step_m = 0.0;         ///< of the readings; 0: none
  double depth_share = 0.0;    ///< kappa of axial_depth
  double fan_rad = 1.0;        ///< landmarks lie within
  bool looks_one_way = false;  ///< else stops face anywhere
};

/// 20 stops known to a centimetre, five landmarks, twelve repeats; f = 0.05 + 0.9 d + 0.05 d^2.
inline Recording recording_of(const Sensor& sensor, const std::string& name, std::uint64_t seed) {
  Random random(seed_from(name, {seed}));
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  add_landmarks(recording, 5);
  std::vector<Eigen::Vector2d> places;
  for (int l = 0; l < 5; ++l) {
    const double side = sensor.looks_one_way ? sensor.fan_rad * (l / 2.0 - 1.0) : 1.2566 * l;
    const double distance = random.uniform(1.4, 3.4);
    places.emplace_back(distance * std::cos(side), distance * std::sin(side));
  }
  for (int k = 0; k < 20; ++k) {
    const double turn = sensor.looks_one_way ? 0.3 : std::numbers::pi;
    const Pose2 commanded{random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-turn, turn)};
    add_stop(recording, commanded, 0.01);
    const Eigen::Vector2d at(random.normal(commanded.x_m, 0.01), random.normal(commanded.y_m, 0.01));
    for (int l = 0; l < 5; ++l) {
      const Eigen::Vector2d way = places[static_cast<std::size_t>(l)] - at;
      const double bearing = wrap_angle(std::atan2(way.y(), way.x()) - commanded.heading_rad);
      const double d = way.norm() * (1.0 - sensor.depth_share * (1.0 - std::cos(bearing)));
      const double f = 0.05 + d * (0.9 + 0.05 * d);
      for (int i = 0; i < 12; ++i) {
        const double y = random.normal(f, sensor.sigma * f * f);
        add_reading(recording, k, l, i,
                    sensor.step_m > 0.0 ? sensor.step_m * std::round(y / sensor.step_m) : y,
                    wrap_angle(bearing + random.normal(0.0, 0.0087)));
      }
    }
  }
  return recording;
}

/// A camera that ranges by depth, y = d cos b, with a spread of 6 mm per metre, and `bump_m` too far between
/// 2 and 2.6 m, which no cause of the catalogue does. A share `wild` of the readings misses by half a metre
/// or so.
inline Recording depth_camera(int readings, double bump_m, double wild, const std::string& name) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from(name, {1}));
  for (int i = 0; i < readings; ++i) {
    const double d = random.uniform(1.0, 5.0), bearing = random.uniform(-0.5, 0.5);
    const double spread = (random.uniform() < wild ? 0.3 : 0.006) * d;
    recording.pairs.true_m.push_back(d);
    recording.pairs.bearing_rad.push_back(bearing);
    recording.pairs.reading_m.push_back(d * std::cos(bearing) + (d > 2.0 && d < 2.6 ? bump_m : 0.0) +
                                        random.normal(0.0, spread));
    recording.pairs.time_s.push_back(i);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

/// Known distances, one reading each, a second apart.
struct WanderingErrors {
  int readings = 0;
  double sigma = 0.0;    ///< s = sigma f
  double wanders = 0.0;  ///< share of the variance that wanders
  double rho = 0.0;      ///< its correlation over a second
  double late = 0.0;     ///< share of readings that are further by an exponential of mean 0.2 m
};

/// f = 0.05 + 0.95 d + 0.02 d^2, d from 1 to 3 m.
inline Recording wandering_pairs(const WanderingErrors& of, const std::string& name,
                                 std::uint64_t number = 0) {
  Random random(seed_from(name, {number}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  double slow = random.normal();
  for (int i = 0; i < of.readings; ++i) {
    const double d = 1.0 + 2.0 / of.readings * ((i * 37) % of.readings), f = 0.05 + d * (0.95 + 0.02 * d);
    slow = of.rho * slow + std::sqrt(1.0 - of.rho * of.rho) * random.normal();
    const double error = std::sqrt(of.wanders) * slow + std::sqrt(1.0 - of.wanders) * random.normal();
    const double echo = random.uniform() < of.late ? -0.2 * std::log(random.uniform()) : 0.0;
    recording.pairs.true_m.push_back(d);
    recording.pairs.time_s.push_back(i);
    recording.pairs.reading_m.push_back(f + of.sigma * f * error + echo);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

inline Diagnosis verdict_of(const Recording& recording) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  return diagnose(std::span(&recording, 1), options);
}

}  // namespace rangecal::testing
