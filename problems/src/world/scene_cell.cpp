// SPDX-License-Identifier: BSD-3-Clause
#include "scene_cell.hpp"

#include <cmath>
#include <limits>
#include <string>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/world/physical/optical_sensor.hpp"

namespace rangecal {

SceneSensor::SceneSensor(const Scene& scene) : scene_(scene) {
  if (!scene.optics) {
    if (scene.alpha.size() == 0) throw InputError("scene: alpha is empty");
    return;
  }
  world_.sensor = scene.optics->sensor;
  world_.head = scene.optics->head;
  world_.timing.repeats = 1;  // nothing of a cell changes from sweep to sweep but its noise
}

double SceneSensor::spread(double d, double f) const {
  const double s = scene_.noise.spread(d, f);
  if (!(s > 0.0) || !std::isfinite(s)) {
    throw InputError("scene: the noise has no positive spread at d = " + std::to_string(d) + " m");
  }
  return s;
}

SceneCell SceneSensor::at(double d) const {
  if (!scene_.optics) return of(d, 0.0, nullptr);
  world::Exposure exposure;
  exposure.distance_m = d;
  exposure.centroid_mm = world::centroid_mm(world_.sensor, world_.ambient, {}, d, 0.0, 0.0);
  world::OpticalSensor fine = world_.sensor;
  fine.centroid_step_px = fine.output_lsb_m = 0.0;
  exposure.range_m = world::firmware_range_m(fine, exposure.centroid_mm, d, 0.0);
  return of(d, 0.0, &exposure);
}

std::vector<world::Exposure> SceneSensor::exposures(const Recording& layout, const Pose2& pose) const {
  if (!scene_.optics) return {};
  world::World world = world_;
  for (std::size_t l = 0; l < layout.landmarks.size(); ++l) {
    world::Cylinder cylinder;
    cylinder.x_m = layout.truth.landmarks[l]->x();
    cylinder.y_m = layout.truth.landmarks[l]->y();
    cylinder.radius_m = cylinder.nominal_radius_m = layout.landmarks[l].radius_m;
    world.landmarks.push_back(cylinder);
  }
  return world::expose(world, {pose});
}

SceneCell SceneSensor::of(double d, double theta, const world::Exposure* exposure) const {
  SceneCell cell;
  if (!scene_.optics) {
    cell.bearing_rad = theta;
    cell.f_m = evaluate_polynomial(scene_.alpha, d);
    cell.spread_m = spread(d, cell.f_m);
    return cell;
  }
  cell.exposure = *exposure;
  cell.bearing_rad = exposure->bearing_rad;
  cell.f_m = exposure->range_m;
  if (std::isfinite(cell.f_m)) cell.spread_m = spread(d, cell.f_m);
  return cell;
}

double SceneSensor::reading(const SceneCell& cell, double e) const {
  if (!scene_.optics) return cell.f_m + cell.spread_m * e;
  if (!std::isfinite(cell.f_m)) return std::numeric_limits<double>::infinity();
  return world::range_output_m(world_, cell.exposure, cell.spread_m * e);
}

}  // namespace rangecal
