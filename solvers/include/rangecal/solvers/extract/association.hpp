// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// A landmark seen from a stop, before it has a name.
struct Sighting {
  int stop = 0;
  double axis_m = 0.0, bearing_rad = 0.0;  ///< raw distance to the axis, direction in the sensor frame
  double range_sd_m = 0.0, bearing_sd_rad = 0.0;
};

struct AssociationOptions {
  StopErrorModel error = StopErrorModel::independent;
  double sigma_xy_m = 0.03, sigma_heading_rad = 0.02;  ///< of a stop, or of one step of a random walk
  double range_slack_m = 0.03,
         range_slack = 0.05;  ///< raw ranges are uncalibrated: off by this, plus this share
  double bearing_slack_rad = 0.01;
  double bearing_offset_rad = 0.0;  ///< added to bearings for the matching alone: mount of the sensor
  double gate = 13.8;               ///< squared Mahalanobis distance, two degrees of freedom: 0.1 %
  double margin = 9.0;  ///< a second landmark within this of the first makes the sighting ambiguous
  int stops_min = 2;    ///< stops from which a landmark must be seen
  std::vector<Eigen::Vector2d> map;  ///< known positions; empty: found from the sightings
};

struct Association {
  std::vector<int> landmark;               ///< per sighting: its landmark, or -1
  std::vector<const char*> reason;         ///< per sighting without one: why
  std::vector<Eigen::Vector2d> landmarks;  ///< positions; of the map where there is one
  std::vector<Pose2> stops;                ///< stops as the landmarks see them
  double cost = 0.0;                       ///< sum of squared Mahalanobis distances
  int matched = 0;
};

/// Names the sightings of all stops. Stop by stop: the pose is predicted from the commanded one (independent), or from
/// the corrected stop before and the commanded step (random walk); every pair of sighting and landmark is gated on
///   e = (axis - |l - s|, bearing - (atan2(l - s) - heading)),  e^T S^-1 e,  S = H P H^T + H_l P_l H_l^T + R;
/// the pairs of least total distance are taken (global nearest neighbour); the pose is corrected by all of them at once
/// and the pairs are chosen again. Poses are rotations and shifts, never reflections, so that a mirrored arrangement
/// does not match. Sightings that match nothing found landmarks. Then landmarks are averaged over their stops, the raw
/// range is bent by a quadratic so that it agrees with them (for the matching alone), and all is done again until no
/// label changes. A sighting with two landmarks within `margin` is left out as ambiguous.
/// Cost: O(sightings x landmarks) per pass, a few passes.
Association associate(std::span<const Pose2> commanded, std::span<const Sighting> sightings,
                      const AssociationOptions& options);

}  // namespace rangecal
