// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// A cylinder in three dimensions: axis through `point` along `axis` (unit), elliptic section with semi-axes
/// `semi` along `side[0]`, `side[1]` (unit, normal to the axis).
struct Surface {
  Eigen::Vector3d point, axis, side[2];
  double semi[2];
};

/// The landmark at the given time, in the frame of a level sensor at `pose` (x forward, y left, z up).
Surface surface_in_sensor(const Cylinder& cylinder, const Pose2& pose, double time_s);

/// Smallest positive t with origin + t direction on the surface; direction need not be a unit vector.
std::optional<double> intersect(const Surface& surface, const Eigen::Vector3d& origin,
                                const Eigen::Vector3d& direction);

/// What the head sees of a landmark, in its own scan plane.
struct Sight {
  double head_rad = 0.0;        ///< direction of the beam that passes through the axis
  double distance_m = 0.0;      ///< along the beam, by the head's rule (nearest point, or mean of hits)
  double half_width_rad = 0.0;  ///< half the angle under which the cylinder is seen
};
Sight look_at(const SpinningHead& head, const Cylinder& cylinder, const Pose2& pose, double time_s);

}  // namespace rangecal::world
