// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/designs.hpp"

#include <array>
#include <numbers>
#include <string>
#include <vector>

namespace rangecal::world {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

/// A mild unit: zero 4 mm, focal length 0.4 % long, laser leaning by 0.1 mrad.
void make_mild(World& world) {
  world.sensor.range_zero_m = 0.004;
  world.sensor.focal_mm = 1.004 * world.sensor.nominal_focal_mm;
  world.sensor.laser_angle_rad = 1e-4;
}

Cylinder cylinder(const char* label, double x, double y, double radius, double reflectance) {
  Cylinder out;
  out.label = label, out.x_m = x, out.y_m = y;
  out.radius_m = out.nominal_radius_m = radius;
  out.reflectance = reflectance;
  return out;
}

void add_stop(World& world, double x, double y, double heading_deg, const std::string& place) {
  Stop stop;
  stop.label = std::to_string(world.robot.stops.size() + 1);
  stop.commanded = {x, y, heading_deg * kDegree};
  stop.place = place;
  world.robot.stops.push_back(stop);
}

}  // namespace

World make_line_design() {
  World world;
  world.name = "line";
  make_mild(world);
  for (int k = 0; k < 20; ++k) add_stop(world, 0.15 * k, 0.0, 0.0, "");
  world.landmarks = {cylinder("A", 0.35, 0.60, 0.12, 0.7), cylinder("B", 1.55, -0.95, 0.12, 0.6),
                     cylinder("C", 2.50, 0.75, 0.12, 0.8), cylinder("D", 3.90, -1.30, 0.12, 0.5),
                     cylinder("E", -0.90, 2.10, 0.12, 0.65)};
  world.timing.repeats = 15;
  return world;
}

World make_turning_design() {
  World world;
  world.name = "turning";
  make_mild(world);
  struct Place {
    double x, y;
    std::vector<double> headings_deg;
  };
  const std::array<Place, 11> places{{{0.0, 0.0, {0, 90, 180, -90}},
                                      {0.6, 0.0, {0}},
                                      {1.2, 0.0, {0, 90}},
                                      {1.8, 0.0, {0, 90, 180, -90}},
                                      {1.8, 0.6, {90}},
                                      {1.8, 1.2, {90, 180}},
                                      {1.8, 1.8, {90, 180, -90, 0}},
                                      {1.2, 1.8, {180}},
                                      {0.6, 1.8, {180, -90}},
                                      {0.0, 1.8, {180, -90}},
                                      {0.0, 1.2, {-90}}}};
  int number = 0;
  for (const Place& place : places) {
    const std::string name = "P" + std::to_string(++number);
    for (const double heading : place.headings_deg) add_stop(world, place.x, place.y, heading, name);
  }
  world.robot.heading_sigma_rad = world.robot.stated_heading_sigma_rad = 0.3 * kDegree;
  world.landmarks = {cylinder("A", 1.20, 0.50, 0.04, 0.7),   cylinder("B", -0.70, 0.55, 0.12, 0.5),
                     cylinder("C", 2.95, -0.45, 0.08, 0.8),  cylinder("D", 2.55, 2.95, 0.12, 0.6),
                     cylinder("E", -1.05, 2.75, 0.04, 0.75), cylinder("F", 0.75, -1.05, 0.08, 0.55)};
  world.timing.repeats = 10;
  world.driver.intensity = world.driver.temperature = true;
  return world;
}

World vary(const World& world, Random& random) {
  World out = world;
  out.sensor.range_zero_m = random.uniform(-0.005, 0.005);
  out.sensor.focal_mm = out.sensor.nominal_focal_mm * (1.0 + random.uniform(-0.005, 0.005));
  out.sensor.laser_angle_rad = random.uniform(-1.5e-4, 1.5e-4);
  out.noise.speckle_per_m = random.uniform(0.002, 0.006);
  out.noise.sigma_theta_rad = random.uniform(0.4, 0.6) * kDegree;
  for (Cylinder& landmark : out.landmarks) {
    landmark.x_m += random.uniform(-0.1, 0.1);
    landmark.y_m += random.uniform(-0.1, 0.1);
    landmark.reflectance = random.uniform(0.4, 0.9);
  }
  return out;
}

}  // namespace rangecal::world
