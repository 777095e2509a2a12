// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/scans.hpp"

#include <cmath>
#include <limits>
#include <optional>

#include "noise_budget.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/cylinder_geometry.hpp"
#include "rangecal/problems/world/physical/optical_sensor.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::world {
namespace {

/// The nearest thing a beam meets.
struct Hit {
  int target = -2;
  double distance_m = std::numeric_limits<double>::infinity();
};

std::optional<double> meet(const Wall& wall, const Pose2& pose, double direction) {
  const double ux = std::cos(direction), uy = std::sin(direction);
  const double wx = wall.x1_m - wall.x0_m, wy = wall.y1_m - wall.y0_m;
  const double px = wall.x0_m - pose.x_m, py = wall.y0_m - pose.y_m;
  const double determinant = uy * wx - ux * wy;
  if (std::abs(determinant) < 1e-12) return std::nullopt;
  const double along_beam = (py * wx - px * wy) / determinant, along_wall = (ux * py - uy * px) / determinant;
  if (along_beam <= 0.0 || along_wall < 0.0 || along_wall > 1.0) return std::nullopt;
  return along_beam;
}

class Caster {
 public:
  Caster(const World& world, const ScanScene& scene, const Pose2& pose, double time_s)
      : world_(world), scene_(scene), pose_(pose), time_s_(time_s) {
    for (const Cylinder& cylinder : world.landmarks)
      surfaces_.push_back(surface_in_sensor(cylinder, pose, time_s));
  }

  Hit cast(double bearing) const {
    Hit hit;
    for (const Wall& wall : scene_.walls) {
      const auto distance = meet(wall, pose_, pose_.heading_rad + bearing);
      if (distance && *distance < hit.distance_m) hit = {-1, *distance};
    }
    const Eigen::Vector3d direction(std::cos(bearing), std::sin(bearing), 0.0);
    for (std::size_t j = 0; j < surfaces_.size(); ++j) {
      const auto distance = intersect(surfaces_[j], Eigen::Vector3d::Zero(), direction);
      if (distance && *distance < hit.distance_m) hit = {static_cast<int>(j), *distance};
    }
    return hit;
  }

  /// The range before noise of a beam whose spot of radius w covers what the beam's two sides meet, in the shares lit.
  double range_m(double bearing, const Hit& hit) const {
    const double single = output_m(hit.distance_m);
    if (!(scene_.spot_radius_m > 0.0) || !std::isfinite(hit.distance_m)) return single;
    const double spread = scene_.spot_radius_m / hit.distance_m;
    double sum = 0.0;
    constexpr int kParts = 9;
    for (int i = 0; i < kParts; ++i) {
      const Hit part = cast(bearing + spread * (2.0 * i / (kParts - 1) - 1.0));
      sum += std::isfinite(part.distance_m) ? output_m(part.distance_m) : single;
    }
    return sum / kParts;
  }

 private:
  double output_m(double distance) const {
    if (!std::isfinite(distance)) return distance;
    const ThermalState base = thermal_state(world_.thermal, time_s_);
    const double x =
        centroid_mm(world_.sensor, world_.ambient, base, with_crosstalk_m(world_.sensor, distance), 0.0, 0.0);
    return firmware_range_m(world_.sensor, x, distance, base.zero_m);
  }

  const World& world_;
  const ScanScene& scene_;
  Pose2 pose_;
  double time_s_;
  std::vector<Surface> surfaces_;
};

Pose2 between(const Pose2& a, const Pose2& b, double share) {
  return {a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m),
          a.heading_rad + share * (b.heading_rad - a.heading_rad)};
}

}  // namespace

SimulatedScans simulate_scans(const World& world, const ScanScene& scene, std::uint64_t seed) {
  SimulatedScans out;
  out.log.path = world.name, out.log.format = "simulated";
  Random noise(seed_from("world.scans", {seed})), loss(seed_from("world.scans.lost", {seed}));
  const std::vector<Pose2> stops = true_stops(world, placing_of(world, seed));
  const Cylinder plain;
  const auto add = [&](const Pose2& robot, double time_s, int stop) {
    const Pose2 sensor = sensor_pose(world, robot, time_s, 0.0, 0.0);
    const Caster caster(world, scene, sensor, time_s);
    Scan scan;
    scan.stamp_s = time_s, scan.row = static_cast<int>(out.log.scans.size()) + 1;
    if (stop >= 0 && scene.label_stops) scan.stop = world.robot.stops[static_cast<std::size_t>(stop)].label;
    ScanTruth truth{sensor, stop, {}};
    for (int i = 0; i < scene.beams; ++i) {
      const double bearing = scene.first_beam_rad + i * scene.step_rad;
      const Hit hit = caster.cast(bearing);
      double range = caster.range_m(bearing, hit);
      const double draw = noise.normal();
      if (std::isfinite(range)) range += draw * range_sd_m(world, plain, hit.distance_m, range, 0.0, time_s);
      if (loss.uniform() < scene.lost_share) range = std::numeric_limits<double>::infinity();
      scan.bearing_rad.push_back(bearing), scan.range_m.push_back(range);
      truth.target.push_back(hit.target);
    }
    out.log.scans.push_back(std::move(scan)), out.truth.push_back(std::move(truth));
  };
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const double start = static_cast<double>(k) * stop_period_s(world);
    for (int q = 0; q < world.timing.repeats; ++q)
      add(stops[k], start + (q + 0.5) * world.head.sweep_period_s, static_cast<int>(k));
    if (k + 1 == stops.size()) break;
    const double leave = start + world.timing.repeats * world.head.sweep_period_s;
    for (int q = 0; q < scene.moving_scans; ++q) {
      const double share = (q + 0.5) / scene.moving_scans;
      add(between(stops[k], stops[k + 1], share), leave + share * world.timing.drive_s, -1);
    }
  }
  return out;
}

}  // namespace rangecal::world
