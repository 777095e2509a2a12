// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Dense>
#include <array>
#include <vector>

#include "rangecal/solvers/extract/association.hpp"

namespace rangecal::extract {

struct PoseBelief {
  Pose2 pose;
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();  ///< of (x, y, heading)
};

struct MapLandmark {
  Eigen::Vector2d position = Eigen::Vector2d::Zero();
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();
};
using Map = std::vector<MapLandmark>;

/// How raw ranges are bent for the matching, and how far they may still be off:
///   axis = shift_0 + r (1 + shift_1 + shift_2 r),   slack_m + slack r
struct RangeBend {
  std::array<double, 3> shift{0.0, 0.0, 0.0};
  double slack_m = 0.0, slack = 0.0;
  Eigen::Vector2d measured(const Sighting& sighting, double bearing_offset) const;
  Eigen::Matrix2d covariance(const Sighting& sighting, double bearing_slack) const;
};

/// The sightings of one stop: (axis distance, bearing) and their covariances.
struct StopView {
  std::vector<Eigen::Vector2d> measured;
  std::vector<Eigen::Matrix2d> noise;
};

struct StopMatch {
  PoseBelief belief;
  std::vector<int> pairs;           ///< per sighting: index into the map, or -1
  std::vector<const char*> reason;  ///< empty for a pair
  std::vector<double> distance;
};

/// Where the stop is expected. `before`: the corrected stop before it, or nullptr for the first.
PoseBelief predicted(const PoseBelief* before, const Pose2& commanded_before, const Pose2& commanded,
                     const AssociationOptions& options);
/// Global nearest neighbour of one stop, the pose corrected and the pairs chosen again until they stay.
StopMatch match_stop(const PoseBelief& prior, const StopView& view, const Map& map,
                     const AssociationOptions& options);
/// The landmark that a sighting would be.
MapLandmark found_landmark(const PoseBelief& belief, const Eigen::Vector2d& measured,
                           const Eigen::Matrix2d& noise);

}  // namespace rangecal::extract
