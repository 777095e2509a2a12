// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/experiments.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <string>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::world {
namespace {

void number_stops(World& world) {
  int number = 0;
  for (Stop& stop : world.robot.stops) stop.label = std::to_string(++number);
}

void turn_at_each_stop(World& world) {
  constexpr int turns = 4;
  const std::vector<Stop> before = world.robot.stops;
  world.robot.stops.clear();
  for (const Stop& stop : before)
    for (int i = 0; i < turns; ++i) {
      Stop turned = stop;
      if (turned.place.empty()) turned.place = "S" + stop.label;
      turned.commanded.heading_rad = wrap_angle(stop.commanded.heading_rad + i * std::numbers::pi / 2);
      world.robot.stops.push_back(turned);
    }
  number_stops(world);
  // What happened at a stop or between two of them still happens there.
  if (world.robot.slip_stop >= 0) world.robot.slip_stop *= turns;
  for (LabelSwap& swap : world.driver.swaps) swap.stop *= turns;
}

void retrace(World& world) {
  const std::vector<Stop> before = world.robot.stops;
  for (auto stop = before.rbegin(); stop != before.rend(); ++stop) {
    Stop again = *stop;
    if (!again.place.empty()) again.place += "-back";  // driven to anew, so with an error of its own
    world.robot.stops.push_back(again);
  }
  number_stops(world);
}

void tape_longest(World& world) {
  Tape tape;
  double longest = -1.0;
  const int count = static_cast<int>(world.landmarks.size());
  for (int a = 0; a < count; ++a)
    for (int b = a + 1; b < count; ++b) {
      const Cylinder& one = world.landmarks[static_cast<std::size_t>(a)];
      const Cylinder& other = world.landmarks[static_cast<std::size_t>(b)];
      const double distance = std::hypot(one.x_m - other.x_m, one.y_m - other.y_m);
      if (distance > longest) longest = distance, tape.from = a, tape.to = b;
    }
  world.tapes.push_back(tape);
}

void several_radii(World& world) {
  constexpr std::array<double, 3> nominal{0.04, 0.12, 0.08};
  std::size_t number = 0;
  for (Cylinder& landmark : world.landmarks) {
    const double scale = landmark.radius_m / landmark.nominal_radius_m;  // a wrong scale stays wrong
    landmark.nominal_radius_m = nominal[number++ % nominal.size()];
    landmark.radius_m = scale * landmark.nominal_radius_m;
  }
}

void nudge(World& world) {
  const std::size_t middle = world.robot.stops.size() / 2;
  for (int i = 1; i <= 5; ++i) {  // at the end of the run, so that nothing else changes its number
    Stop near = world.robot.stops[middle];
    near.place.clear();
    near.commanded.x_m += 0.005 * i * std::cos(near.commanded.heading_rad);
    near.commanded.y_m += 0.005 * i * std::sin(near.commanded.heading_rad);
    world.robot.stops.push_back(near);
  }
  number_stops(world);
}

void near_and_far(World& world) {
  const std::vector<Stop>& stops = world.robot.stops;
  const Pose2 &first = stops.front().commanded, &middle = stops[stops.size() / 2].commanded;
  Cylinder near, far;
  near.radius_m = near.nominal_radius_m = far.radius_m = far.nominal_radius_m = 0.12;
  near.label = "near", far.label = "far";
  near.x_m =
      middle.x_m - 0.52 * std::sin(middle.heading_rad);  // surface 0.4 m to the left of the middle stop
  near.y_m = middle.y_m + 0.52 * std::cos(middle.heading_rad);
  far.x_m = first.x_m - 4.2, far.y_m = first.y_m - 1.0;
  world.landmarks.push_back(near);
  world.landmarks.push_back(far);
}

}  // namespace

const std::vector<Experiment>& experiments() {
  static const std::vector<Experiment> list{{"E1", "turn the sensor to 0, 90, 180, 270 degrees at each stop"},
                                            {"E2", "drive the same stops in reverse order"},
                                            {"E3", "tape the distance between two landmarks"},
                                            {"E4", "use landmarks of several radii"},
                                            {"E7", "record 200 sweeps at each stop"},
                                            {"E8", "move one stop by 5 mm, five times"},
                                            {"E9", "place landmarks at 0.4 m and at the far end"},
                                            {"E10", "lights off"},
                                            {"E11", "wait longer before reading"},
                                            {"E12", "warm the sensor up before reading"}};
  return list;
}

World carry_out(const World& world, std::string_view code) {
  World out = world;
  int stops_for_one = 1;
  if (code == "E1") {
    stops_for_one = 4;
    turn_at_each_stop(out);
  } else if (code == "E2") {
    retrace(out);
  } else if (code == "E3") {
    tape_longest(out);
  } else if (code == "E4") {
    several_radii(out);
  } else if (code == "E7") {
    out.timing.repeats = 200;
  } else if (code == "E8") {
    nudge(out);
  } else if (code == "E9") {
    near_and_far(out);
  } else if (code == "E10") {
    out.ambient.ratio = 0.0;
  } else if (code == "E11") {
    out.timing.wait_s += 10.0;
    out.robot.creep_mps = out.robot.creep_radps = 0.0;
  } else if (code == "E12") {
    out.thermal.soaked_s += 2700.0;  // 45 min
  } else {
    throw InputError("experiment '" + std::string(code) +
                     "' is not one that the physical world can carry out");
  }
  for (Cylinder& landmark : out.landmarks) {  // pushed before the same stop as in the first experiment
    if (landmark.move_time_s < 0.0) continue;
    const double stop = (landmark.move_time_s + 0.5 * world.timing.drive_s) / stop_period_s(world);
    landmark.move_time_s = stops_for_one * stop * stop_period_s(out) - 0.5 * out.timing.drive_s;
  }
  return out;
}

}  // namespace rangecal::world
