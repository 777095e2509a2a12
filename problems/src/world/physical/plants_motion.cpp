// SPDX-License-Identifier: BSD-3-Clause
// Departures of the robot, of the landmarks' places and of the labels: M1 to M6 and W1 to W3 of the
// catalogue.
#include <algorithm>
#include <cmath>

#include "plant_entry.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::world {
namespace {

using enum EffectClass;

void odometry_scale(World& world, double size, Random&) {
  Robot& robot = world.robot;  // wheels and track alike: turns stay right
  robot.left_radius_m *= 1.0 + size;
  robot.right_radius_m *= 1.0 + size;
  robot.track_m *= 1.0 + size;
  world.truth["odometry_scale.scale"] = size;
}

void path_curvature(World& world, double size, Random&) {
  // kappa = (r_right - r_left) / (r track) at the same wheel angle
  Robot& robot = world.robot;
  robot.left_radius_m *= 1.0 - 0.5 * size * robot.track_m;
  robot.right_radius_m *= 1.0 + 0.5 * size * robot.track_m;
  world.truth["path_curvature.curvature_per_m"] = size;
}

void heading_drift(World& world, double size, Random&) {
  world.robot.heading_drift_rad_per_s += size / run_length_s(world);
  world.truth["heading_drift.angle_rad"] = size;  // over the run
}

void odometry_random_walk(World& world, double size, Random&) {
  Robot& robot = world.robot;  // the slip takes the place of the independent error as far as it goes
  const double left = robot.placing_sigma_m * robot.placing_sigma_m - size * size;
  robot.placing_sigma_m = std::sqrt(std::max(0.0, left));
  robot.walk_sigma_m = size;
  world.truth["odometry_random_walk.step_m"] = size;
}

void lever_arm(World& world, double size, Random& random) {
  const double direction = any_angle(random);
  world.robot.lever_x_m = size * std::cos(direction);
  world.robot.lever_y_m = size * std::sin(direction);
  world.truth["lever_arm.x_m"] = world.robot.lever_x_m;
  world.truth["lever_arm.y_m"] = world.robot.lever_y_m;
}

/// A stop in the middle third that is reached by driving in the direction in which it then looks.
int straight_stop(const World& world, Random& random) {
  const std::vector<Stop>& stops = world.robot.stops;
  const std::size_t count = stops.size();
  std::size_t k = count / 2;
  for (int draw = 0; draw < 60; ++draw) {
    k = count / 3 + static_cast<std::size_t>(random.index(std::max<std::size_t>(1, count / 3)));
    if (k == 0) continue;
    const Pose2 &from = stops[k - 1].commanded, &to = stops[k].commanded;
    const double dx = to.x_m - from.x_m, dy = to.y_m - from.y_m;
    if (std::hypot(dx, dy) > 1e-6 && std::abs(wrap_angle(std::atan2(dy, dx) - to.heading_rad)) < 1e-6) break;
  }
  return static_cast<int>(k);
}

void wheel_slip(World& world, double size, Random& random) {
  world.robot.slip_stop = straight_stop(world, random);
  world.robot.slip_m = size;
  world.truth["wheel_slip.distance_m"] = size;
  world.truth["wheel_slip.stop"] = world.robot.slip_stop;
}

void moved_landmark(World& world, double size, Random& random) {
  const std::size_t l = any_landmark(world, random);
  const double direction = any_angle(random);
  Cylinder& landmark = world.landmarks[l];
  // somebody pushes it while the robot drives from one stop to the next
  const double per_stop = stop_period_s(world);
  const double stop = std::floor(random.uniform(0.3, 0.7) * static_cast<double>(world.robot.stops.size()));
  landmark.move_time_s = stop * per_stop - 0.5 * world.timing.drive_s;
  landmark.move_x_m = size * std::cos(direction);
  landmark.move_y_m = size * std::sin(direction);
  world.truth["moved_landmark.landmark"] = static_cast<double>(l);
  world.truth["moved_landmark.time_s"] = landmark.move_time_s;
  world.truth["moved_landmark.x_m"] = landmark.move_x_m;
  world.truth["moved_landmark.y_m"] = landmark.move_y_m;
}

void label_swap(World& world, double size, Random& random) {
  const int landmarks = static_cast<int>(world.landmarks.size()),
            stops = static_cast<int>(world.robot.stops.size());
  const int a = static_cast<int>(any_landmark(world, random));
  const int b =
      (a + 1 + static_cast<int>(random.index(static_cast<std::uint64_t>(landmarks - 1)))) % landmarks;
  const int wanted = std::min(static_cast<int>(std::lround(size)), stops);
  std::vector<int> chosen;
  while (static_cast<int>(chosen.size()) < wanted) {
    const int stop = static_cast<int>(random.index(static_cast<std::uint64_t>(stops)));
    if (std::find(chosen.begin(), chosen.end(), stop) == chosen.end()) chosen.push_back(stop);
  }
  for (const int stop : chosen) world.driver.swaps.push_back({stop, a, b});
  world.truth["label_swap.stops"] = wanted;
  world.truth["label_swap.first"] = std::min(a, b);
  world.truth["label_swap.second"] = std::max(a, b);
}

void dropout(World& world, double size, Random&) {
  const std::vector<double> ranges = overview(world).range_m;
  world.driver.far_limit_m = *std::max_element(ranges.begin(), ranges.end()) - size;
  world.truth["dropout.limit_m"] = world.driver.far_limit_m;
}

}  // namespace

std::vector<PlantEntry> motion_plants() {
  const std::vector<std::string> any{"stop", "range", "bearing"};
  return {
      {{"odometry_scale", "1", 0.01, 0.05, absorbed, any, {"stop"}, true, "both wheels and the track larger"},
       odometry_scale},
      {{"path_curvature",
        "1/m",
        0.02,
        0.2,
        mean,
        any,
        {"stop", "time"},
        true,
        "one wheel larger than the other"},
       path_curvature},
      {{"heading_drift",
        "rad per run",
        0.01745,
        0.0873,
        mean,
        {"bearing", "stop"},
        {"time", "stop"},
        true,
        "the base turns slowly"},
       heading_drift},
      {{"odometry_random_walk", "m", 0.01, 0.05, dependence, any, {"stop", "time"}, true, "slip accumulates"},
       odometry_random_walk},
      {{"lever_arm",
        "m",
        0.02,
        0.1,
        mean,
        any,
        {"heading", "sensor_bearing"},
        true,
        "lidar beside the turning point"},
       lever_arm},
      {{"wheel_slip", "m", 0.05, 0.3, mean, any, {"stop", "time"}, true, "one slip on the way"}, wheel_slip},
      {{"moved_landmark",
        "m",
        0.02,
        0.2,
        mean,
        {"range", "bearing"},
        {"landmark", "time", "stop"},
        true,
        "a landmark is pushed"},
       moved_landmark},
      {{"label_swap",
        "stops",
        2.0,
        6.0,
        label,
        {"label"},
        {"landmark", "stop", "any"},
        true,
        "two labels exchanged at some stops"},
       label_swap},
      {{"dropout",
        "m",
        0.3,
        1.0,
        detection,
        {"detection"},
        {"range", "landmark", "any"},
        true,
        "returns beyond a range are lost"},
       dropout},
  };
}

}  // namespace rangecal::world
