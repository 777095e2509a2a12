// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/robot_path.hpp"

#include <cmath>
#include <map>

#include "rangecal/core/angles.hpp"
#include "rangecal/problems/world/physical/spinning_head.hpp"

namespace rangecal::world {
namespace {

/// Rolls the wheels by what their encoders were told and moves the pose along the exact arc.
void roll(const Robot& robot, double left_m, double right_m, Pose2& pose) {
  const double left = left_m * robot.left_radius_m / robot.nominal_wheel_radius_m;
  const double right = right_m * robot.right_radius_m / robot.nominal_wheel_radius_m;
  const double path = 0.5 * (left + right), turn = (right - left) / robot.track_m;
  const double half = 0.5 * turn;
  const double chord = std::abs(half) < 1e-8 ? path : path * std::sin(half) / half;
  pose.x_m += chord * std::cos(pose.heading_rad + half);
  pose.y_m += chord * std::sin(pose.heading_rad + half);
  pose.heading_rad += turn;
}

void turn_by(const Robot& robot, double angle, Pose2& pose) {
  roll(robot, -0.5 * angle * robot.nominal_track_m, 0.5 * angle * robot.nominal_track_m, pose);
}

bool same_place(const Stop& a, const Stop& b) { return !a.place.empty() && a.place == b.place; }

}  // namespace

Placing no_placing_error(const World& world) { return {std::vector<Pose2>(world.robot.stops.size())}; }

Placing draw_placing(const World& world, Random& random) {
  const Robot& robot = world.robot;
  Placing placing = no_placing_error(world);
  std::map<std::string, Pose2> of_place;
  double walk_x = 0.0, walk_y = 0.0;
  for (std::size_t k = 0; k < robot.stops.size(); ++k) {
    const double step_x = random.normal(), step_y = random.normal();
    const double at_x = random.normal(), at_y = random.normal(), turned = random.normal();
    if (k > 0 && !same_place(robot.stops[k], robot.stops[k - 1])) {
      walk_x += robot.walk_sigma_m * step_x;
      walk_y += robot.walk_sigma_m * step_y;
    }
    Pose2 here{robot.placing_sigma_m * at_x, robot.placing_sigma_m * at_y, 0.0};
    if (!robot.stops[k].place.empty()) here = of_place.try_emplace(robot.stops[k].place, here).first->second;
    placing.error[k] = {here.x_m + walk_x, here.y_m + walk_y, robot.heading_sigma_rad * turned};
  }
  return placing;
}

std::vector<Pose2> true_stops(const World& world, const Placing& placing) {
  const Robot& robot = world.robot;
  std::vector<Pose2> stops;
  if (robot.stops.empty()) return stops;
  Pose2 pose = robot.stops.front().commanded;
  double slip_x = 0.0, slip_y = 0.0;
  for (std::size_t k = 0; k < robot.stops.size(); ++k) {
    if (k > 0) {
      const Pose2& from = robot.stops[k - 1].commanded;
      const Pose2& to = robot.stops[k].commanded;
      const double dx = to.x_m - from.x_m, dy = to.y_m - from.y_m, length = std::hypot(dx, dy);
      double heading = from.heading_rad;
      if (length > 1e-9) {
        const double towards = std::atan2(dy, dx);
        turn_by(robot, wrap_angle(towards - heading), pose);
        roll(robot, length, length, pose);
        heading = towards;
      }
      turn_by(robot, wrap_angle(to.heading_rad - heading), pose);
    }
    if (static_cast<int>(k) == robot.slip_stop) {
      slip_x = robot.slip_m * std::cos(pose.heading_rad);
      slip_y = robot.slip_m * std::sin(pose.heading_rad);
    }
    const Pose2& error = placing.error.at(k);
    stops.push_back({pose.x_m + slip_x + error.x_m, pose.y_m + slip_y + error.y_m,
                     wrap_angle(pose.heading_rad + error.heading_rad)});
  }
  return stops;
}

Pose2 sensor_pose(const World& world, const Pose2& robot, double time_s, double since_stop_s,
                  double in_sweep_s) {
  const Robot& base = world.robot;
  Pose2 pose = robot;
  pose.x_m += base.creep_mps * in_sweep_s * std::cos(robot.heading_rad);
  pose.y_m += base.creep_mps * in_sweep_s * std::sin(robot.heading_rad);
  pose.heading_rad += base.creep_radps * in_sweep_s + base.heading_drift_rad_per_s * time_s;
  const double c = std::cos(pose.heading_rad), s = std::sin(pose.heading_rad);
  pose.x_m += c * base.lever_x_m - s * base.lever_y_m;
  pose.y_m += s * base.lever_x_m + c * base.lever_y_m;
  pose.heading_rad += swing_rad(world.head, since_stop_s);
  return pose;
}

}  // namespace rangecal::world
