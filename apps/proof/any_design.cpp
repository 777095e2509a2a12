// SPDX-License-Identifier: BSD-3-Clause
#include "any_design.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/physical/designs.hpp"

namespace rangecal::proof {
namespace {

constexpr double degree = std::numbers::pi / 180.0;

int between(int low, int high, Random& random) {
  return low + static_cast<int>(random.index(static_cast<std::uint64_t>(high - low + 1)));
}

double either_sign(Random& random) { return random.uniform() < 0.5 ? -1.0 : 1.0; }

/// An arc of equal steps; straight without a turn.
std::vector<Pose2> arc(int stops, double length_m, double turn_rad, Random& random) {
  const double step = length_m / (stops - 1), bend = turn_rad / (stops - 1);
  const double chord = std::abs(bend) < 1e-9 ? step : step * std::sin(0.5 * bend) / (0.5 * bend);
  std::vector<Pose2> path{{0.0, 0.0, random.uniform(-std::numbers::pi, std::numbers::pi)}};
  while (static_cast<int>(path.size()) < stops) {
    const Pose2& at = path.back();
    path.push_back({at.x_m + chord * std::cos(at.heading_rad + 0.5 * bend),
                    at.y_m + chord * std::sin(at.heading_rad + 0.5 * bend), at.heading_rad + bend});
  }
  for (Pose2& pose : path) pose.heading_rad = wrap_angle(pose.heading_rad);
  return path;
}

std::vector<Pose2> random_path(int stops, Random& random) {
  constexpr double side_m = 3.5;
  const auto any = [&] { return random.uniform(-std::numbers::pi, std::numbers::pi); };
  std::vector<Pose2> path{{random.uniform(0.0, side_m), random.uniform(0.0, side_m), any()}};
  double way = path[0].heading_rad;
  const bool turns_at_stops = random.uniform() < 0.5;
  while (static_cast<int>(path.size()) < stops) {
    const double towards = way + random.normal(0.0, 0.6), step = random.uniform(0.1, 0.8);
    const double x = path.back().x_m + step * std::cos(towards),
                 y = path.back().y_m + step * std::sin(towards);
    if (std::clamp(x, 0.0, side_m) != x || std::clamp(y, 0.0, side_m) != y) {
      way = any();  // before a wall
      continue;
    }
    way = towards;
    path.push_back({x, y, turns_at_stops ? any() : wrap_angle(way)});
  }
  return path;
}

std::vector<Pose2> any_path(Random& random) {
  const int stops = between(5, 60, random);
  const auto kind = random.index(3);
  if (kind == 0) return arc(stops, random.uniform(1.0, 5.0), 0.0, random);
  if (kind == 1) {
    const double length = random.uniform(1.5, 5.0);
    return arc(stops, length, either_sign(random) * random.uniform(30.0, 270.0) * degree, random);
  }
  return random_path(stops, random);
}

/// Room for a landmark, with the 0.1 m that world::vary may move it by.
bool is_free(const world::World& world, const world::Cylinder& landmark) {
  const auto apart = [&](double x, double y) { return std::hypot(landmark.x_m - x, landmark.y_m - y); };
  constexpr double moved = 0.1 * std::numbers::sqrt2;
  for (const Stop& stop : world.robot.stops)
    if (apart(stop.commanded.x_m, stop.commanded.y_m) < 0.35 + landmark.radius_m + moved) return false;
  for (const world::Cylinder& other : world.landmarks)
    if (apart(other.x_m, other.y_m) < 0.1 + landmark.radius_m + other.radius_m + 2.0 * moved) return false;
  return true;
}

void add_landmarks(world::World& world, Random& random) {
  constexpr double around_m = 1.5;
  double low_x = 1e9, high_x = -1e9, low_y = 1e9, high_y = -1e9;
  for (const Stop& stop : world.robot.stops) {
    low_x = std::min(low_x, stop.commanded.x_m), high_x = std::max(high_x, stop.commanded.x_m);
    low_y = std::min(low_y, stop.commanded.y_m), high_y = std::max(high_y, stop.commanded.y_m);
  }
  const auto wanted = static_cast<std::size_t>(between(3, 12, random));
  for (int draw = 0; world.landmarks.size() < wanted; ++draw) {
    if (draw == 10000) throw InputError("no room for the landmarks of a random design");
    world::Cylinder landmark;
    landmark.label = std::string(1, static_cast<char>('A' + world.landmarks.size()));
    landmark.radius_m = landmark.nominal_radius_m = 0.04 * between(1, 3, random);
    landmark.x_m = random.uniform(low_x - around_m, high_x + around_m);
    landmark.y_m = random.uniform(low_y - around_m, high_y + around_m);
    if (is_free(world, landmark)) world.landmarks.push_back(landmark);
  }
}

}  // namespace

world::World any_design(Random& random) {
  world::World world;
  world.name = "any";
  for (const Pose2& pose : any_path(random)) {
    Stop stop;
    stop.label = std::to_string(world.robot.stops.size() + 1);
    stop.commanded = pose;
    world.robot.stops.push_back(stop);
  }
  add_landmarks(world, random);
  world.timing.repeats = between(1, 30, random);
  world.robot.placing_sigma_m = world.robot.stated_sigma_m =
      std::exp(random.uniform(std::log(0.002), std::log(0.02)));
  if (random.uniform() < 0.5)
    world.robot.heading_sigma_rad = world.robot.stated_heading_sigma_rad = random.uniform(0.1, 0.5) * degree;
  world.driver.intensity = random.uniform() < 0.5;
  world.driver.temperature = random.uniform() < 0.5;
  return world::vary(world, random);
}

}  // namespace rangecal::proof
