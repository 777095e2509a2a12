// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/cylinder_geometry.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/core/angles.hpp"

namespace rangecal::world {
namespace {

Eigen::Vector2d axis_in_sensor(const Cylinder& cylinder, const Pose2& pose, double time_s) {
  Eigen::Vector2d axis(cylinder.x_m - pose.x_m, cylinder.y_m - pose.y_m);
  if (cylinder.move_time_s >= 0.0 && time_s >= cylinder.move_time_s)
    axis += Eigen::Vector2d(cylinder.move_x_m, cylinder.move_y_m);
  const double c = std::cos(pose.heading_rad), s = std::sin(pose.heading_rad);
  return {c * axis.x() + s * axis.y(), -s * axis.x() + c * axis.y()};
}

/// Head direction whose beam, offset by q to the left, passes through a point at the given bearing and
/// distance.
double aim_through(double bearing, double distance, double q) { return bearing - std::asin(q / distance); }

template <typename Function>
double minimum(const Function& function, double low, double high) {
  constexpr double golden = 0.6180339887498949;
  double a = high - golden * (high - low), b = low + golden * (high - low);
  double fa = function(a), fb = function(b);
  for (int i = 0; i < 40; ++i) {
    if (fa < fb) {
      high = b, b = a, fb = fa;
      a = high - golden * (high - low), fa = function(a);
    } else {
      low = a, a = b, fa = fb;
      b = low + golden * (high - low), fb = function(b);
    }
  }
  return std::min(fa, fb);
}

/// Beams of a head whose scan plane may be tilted.
struct Beams {
  Eigen::Vector3d forward, left;
  double offset;

  explicit Beams(const SpinningHead& head) : offset(head.beam_offset_m) {
    const Eigen::Vector3d axis(std::cos(head.tilt_axis_rad), std::sin(head.tilt_axis_rad), 0.0);
    const Eigen::AngleAxisd tilt(head.tilt_rad, axis);
    forward = tilt * Eigen::Vector3d::UnitX();
    left = tilt * Eigen::Vector3d::UnitY();
  }
  Eigen::Vector3d direction(double angle) const { return std::cos(angle) * forward + std::sin(angle) * left; }
  Eigen::Vector3d origin(double angle) const {
    return offset * (-std::sin(angle) * forward + std::cos(angle) * left);
  }
};

double mean_of_hits(const Beams& beams, const Surface& surface, double centre, double half_width) {
  constexpr int count = 201;
  double sum = 0.0;
  int hits = 0;
  for (int i = 0; i < count; ++i) {
    const double angle = centre + half_width * (2.0 * i + 1.0 - count) / count;
    if (const auto t = intersect(surface, beams.origin(angle), beams.direction(angle))) sum += *t, ++hits;
  }
  return sum / std::max(hits, 1);
}

}  // namespace

Surface surface_in_sensor(const Cylinder& cylinder, const Pose2& pose, double time_s) {
  Surface surface;
  surface.point.setZero();
  surface.point.head<2>() = axis_in_sensor(cylinder, pose, time_s);
  const Eigen::AngleAxisd to_sensor(-pose.heading_rad, Eigen::Vector3d::UnitZ());
  const Eigen::Vector3d lean_about(-std::sin(cylinder.lean_azimuth_rad), std::cos(cylinder.lean_azimuth_rad),
                                   0.0);
  const Eigen::Quaterniond turn(to_sensor * Eigen::AngleAxisd(cylinder.lean_rad, lean_about) *
                                Eigen::AngleAxisd(cylinder.long_axis_rad, Eigen::Vector3d::UnitZ()));
  surface.side[0] = turn * Eigen::Vector3d::UnitX();
  surface.side[1] = turn * Eigen::Vector3d::UnitY();
  surface.axis = turn * Eigen::Vector3d::UnitZ();
  surface.semi[0] = cylinder.radius_m * (1.0 + cylinder.out_of_round);
  surface.semi[1] = cylinder.radius_m * (1.0 - cylinder.out_of_round);
  return surface;
}

std::optional<double> intersect(const Surface& surface, const Eigen::Vector3d& origin,
                                const Eigen::Vector3d& direction) {
  // Sum_i (p_i + t v_i)^2 = 1 in units of the semi-axes.
  double vv = 0.0, pv = 0.0, pp = 0.0;
  for (int i = 0; i < 2; ++i) {
    const double p = surface.side[i].dot(origin - surface.point) / surface.semi[i];
    const double v = surface.side[i].dot(direction) / surface.semi[i];
    vv += v * v, pv += p * v, pp += p * p;
  }
  const double discriminant = pv * pv - vv * (pp - 1.0);
  if (discriminant < 0.0 || vv == 0.0) return std::nullopt;
  const double t = (-pv - std::sqrt(discriminant)) / vv;
  return t > 0.0 ? std::optional(t) : std::nullopt;
}

Sight look_at(const SpinningHead& head, const Cylinder& cylinder, const Pose2& pose, double time_s) {
  const double q = head.beam_offset_m;
  const bool round_and_plumb =
      head.tilt_rad == 0.0 && cylinder.lean_rad == 0.0 && cylinder.out_of_round == 0.0;
  Sight sight;
  if (round_and_plumb) {
    const Eigen::Vector2d axis = axis_in_sensor(cylinder, pose, time_s);
    const double distance = axis.norm();
    sight.head_rad = aim_through(std::atan2(axis.y(), axis.x()), distance, q);
    sight.half_width_rad = std::asin(std::min(1.0, cylinder.radius_m / distance));
    if (!head.mean_of_hits) {
      // The surface point nearest to the spin axis, along a beam that passes that axis at q.
      const double nearest = distance - cylinder.radius_m;
      sight.distance_m = std::sqrt(nearest * nearest - q * q);
      return sight;
    }
  }
  const Beams beams(head);
  const Surface surface = surface_in_sensor(cylinder, pose, time_s);
  const Eigen::Vector3d normal = beams.forward.cross(beams.left);
  const Eigen::Vector3d pierced =
      surface.point - surface.axis * (normal.dot(surface.point) / normal.dot(surface.axis));
  const double u = beams.forward.dot(pierced), v = beams.left.dot(pierced), distance = std::hypot(u, v);
  sight.head_rad = aim_through(std::atan2(v, u), distance, q);
  sight.half_width_rad = std::asin(std::min(1.0, cylinder.radius_m / distance));
  if (head.mean_of_hits) {
    const double edge = std::asin(std::min(1.0, head.hit_share * cylinder.radius_m / distance));
    sight.distance_m = mean_of_hits(beams, surface, sight.head_rad, edge);
    return sight;
  }
  const double narrow = std::asin(std::min(1.0, std::min(surface.semi[0], surface.semi[1]) / distance));
  const auto range = [&](double angle) {
    return intersect(surface, beams.origin(angle), beams.direction(angle)).value_or(1e3 * distance);
  };
  sight.distance_m = minimum(range, sight.head_rad - 0.95 * narrow, sight.head_rad + 0.95 * narrow);
  return sight;
}

}  // namespace rangecal::world
