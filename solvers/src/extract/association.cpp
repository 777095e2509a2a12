// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/association.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "extract/association_parts.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/solvers/extract/assignment.hpp"

namespace rangecal {
namespace extract {
namespace {

constexpr double kForbidden = std::numeric_limits<double>::infinity();

Eigen::Vector2d seen_from(const Pose2& pose, const Eigen::Vector2d& landmark) {
  const Eigen::Vector2d v(landmark.x() - pose.x_m, landmark.y() - pose.y_m);
  return {v.norm(), wrap_angle(std::atan2(v.y(), v.x()) - pose.heading_rad)};
}

/// d(axis, bearing) / d(landmark); the pose's is its negative, and (0, -1) for the heading.
Eigen::Matrix2d slope_at(const Pose2& pose, const Eigen::Vector2d& landmark) {
  const double dx = landmark.x() - pose.x_m, dy = landmark.y() - pose.y_m,
               d2 = std::max(dx * dx + dy * dy, 1e-6);
  const double d = std::sqrt(d2);
  Eigen::Matrix2d slope;
  slope << dx / d, dy / d, -dy / d2, dx / d2;
  return slope;
}

struct Comparison {
  Eigen::Vector2d innovation;
  Eigen::Matrix<double, 2, 3> by_pose;
  Eigen::Matrix2d noise;  ///< of the sighting and the landmark
  double distance = 0.0;  ///< squared Mahalanobis
};

}  // namespace

Eigen::Vector2d RangeBend::measured(const Sighting& sighting, double bearing_offset) const {
  const double r = sighting.axis_m;
  return {shift[0] + r * (1.0 + shift[1] + r * shift[2]), wrap_angle(sighting.bearing_rad + bearing_offset)};
}

Eigen::Matrix2d RangeBend::covariance(const Sighting& sighting, double bearing_slack) const {
  const double range = std::hypot(sighting.range_sd_m, slack_m + slack * sighting.axis_m);
  const double bearing = std::hypot(sighting.bearing_sd_rad, bearing_slack);
  return Eigen::Vector2d(range * range, bearing * bearing).asDiagonal();
}

namespace {

Comparison compare(const PoseBelief& belief, const Eigen::Vector2d& measured, const Eigen::Matrix2d& noise,
                   const MapLandmark& landmark) {
  Comparison out;
  const Eigen::Vector2d expected = seen_from(belief.pose, landmark.position);
  out.innovation = measured - expected;
  out.innovation(1) = wrap_angle(out.innovation(1));
  const Eigen::Matrix2d slope = slope_at(belief.pose, landmark.position);
  out.by_pose << -slope, Eigen::Vector2d(0.0, -1.0);
  out.noise = noise + slope * landmark.covariance * slope.transpose();
  const Eigen::Matrix2d total = out.by_pose * belief.covariance * out.by_pose.transpose() + out.noise;
  out.distance = out.innovation.dot(total.ldlt().solve(out.innovation));
  return out;
}

/// The belief corrected by all pairs at once, linearised anew three times (iterated extended Kalman filter).
PoseBelief corrected(const PoseBelief& prior, const StopView& view, const std::vector<int>& pairs,
                     const Map& map) {
  const Eigen::Matrix3d prior_information = prior.covariance.inverse();
  PoseBelief belief = prior;
  for (int round = 0; round < 3; ++round) {
    Eigen::Matrix3d information = prior_information;
    Eigen::Vector3d gradient =
        prior_information * Eigen::Vector3d(prior.pose.x_m - belief.pose.x_m,
                                            prior.pose.y_m - belief.pose.y_m,
                                            wrap_angle(prior.pose.heading_rad - belief.pose.heading_rad));
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      if (pairs[i] < 0) continue;
      const Comparison pair =
          compare(belief, view.measured[i], view.noise[i], map[static_cast<std::size_t>(pairs[i])]);
      const Eigen::Matrix2d weight = pair.noise.inverse();
      information += pair.by_pose.transpose() * weight * pair.by_pose;
      gradient += pair.by_pose.transpose() * weight * pair.innovation;
    }
    const Eigen::Vector3d step = information.ldlt().solve(gradient);
    belief.pose.x_m += step(0), belief.pose.y_m += step(1);
    belief.pose.heading_rad = wrap_angle(belief.pose.heading_rad + step(2));
    belief.covariance = information.inverse();
  }
  return belief;
}

Eigen::MatrixXd distances(const PoseBelief& belief, const StopView& view, const Map& map, double gate) {
  Eigen::MatrixXd cost(static_cast<Eigen::Index>(view.measured.size()),
                       static_cast<Eigen::Index>(map.size()));
  for (Eigen::Index i = 0; i < cost.rows(); ++i)
    for (Eigen::Index j = 0; j < cost.cols(); ++j) {
      const auto row = static_cast<std::size_t>(i), column = static_cast<std::size_t>(j);
      const double distance = compare(belief, view.measured[row], view.noise[row], map[column]).distance;
      cost(i, j) = distance <= gate ? distance : kForbidden;
    }
  return cost;
}

}  // namespace

StopMatch match_stop(const PoseBelief& prior, const StopView& view, const Map& map,
                     const AssociationOptions& options) {
  StopMatch match;
  match.belief = prior;
  match.pairs.assign(view.measured.size(), -1);
  match.reason.assign(view.measured.size(), "matches no landmark");
  match.distance.assign(view.measured.size(), 0.0);
  if (map.empty()) return match;
  Eigen::MatrixXd cost;
  for (int round = 0; round < 4; ++round) {
    cost = distances(match.belief, view, map, options.gate);
    const std::vector<int> pairs = assign(cost, options.gate);
    const bool same = round > 0 && pairs == match.pairs;
    match.pairs = pairs;
    if (same) break;
    match.belief = corrected(prior, view, pairs, map);
  }
  for (std::size_t i = 0; i < match.pairs.size(); ++i) {
    const auto row = cost.row(static_cast<Eigen::Index>(i));
    if (match.pairs[i] < 0) {
      if (row.minCoeff() < kForbidden) match.reason[i] = "second sighting of one landmark";
      continue;
    }
    const double best = row(match.pairs[i]);
    for (Eigen::Index j = 0; j < row.size(); ++j)
      if (j != match.pairs[i] && row(j) < best + options.margin) match.reason[i] = "ambiguous";
    if (std::string_view(match.reason[i]) == "ambiguous") {
      match.pairs[i] = -1;
      continue;
    }
    match.distance[i] = best;
    match.reason[i] = "";
  }
  return match;
}

MapLandmark found_landmark(const PoseBelief& belief, const Eigen::Vector2d& measured,
                           const Eigen::Matrix2d& noise) {
  const double direction = belief.pose.heading_rad + measured(1);
  const Eigen::Vector2d along(std::cos(direction), std::sin(direction)), across(-along.y(), along.x());
  MapLandmark out;
  out.position = Eigen::Vector2d(belief.pose.x_m, belief.pose.y_m) + measured(0) * along;
  Eigen::Matrix<double, 2, 3> by_pose;
  by_pose << Eigen::Matrix2d::Identity(), measured(0) * across;
  Eigen::Matrix2d by_reading;
  by_reading << along, measured(0) * across;
  out.covariance =
      by_pose * belief.covariance * by_pose.transpose() + by_reading * noise * by_reading.transpose();
  return out;
}

PoseBelief predicted(const PoseBelief* before, const Pose2& commanded_before, const Pose2& commanded,
                     const AssociationOptions& options) {
  const double xy = options.sigma_xy_m * options.sigma_xy_m,
               heading = options.sigma_heading_rad * options.sigma_heading_rad;
  PoseBelief out;
  out.covariance = Eigen::Vector3d(xy, xy, heading).asDiagonal();
  out.pose = commanded;
  if (!before || options.error == StopErrorModel::independent) return out;
  // The commanded step, seen from the stop before, carried to where that stop is believed to be.
  const double turn = before->pose.heading_rad - commanded_before.heading_rad;
  const double dx = commanded.x_m - commanded_before.x_m, dy = commanded.y_m - commanded_before.y_m;
  const double sx = std::cos(turn) * dx - std::sin(turn) * dy, sy = std::sin(turn) * dx + std::cos(turn) * dy;
  out.pose = {before->pose.x_m + sx, before->pose.y_m + sy, wrap_angle(commanded.heading_rad + turn)};
  Eigen::Matrix3d carry = Eigen::Matrix3d::Identity();
  carry(0, 2) = -sy, carry(1, 2) = sx;
  out.covariance += carry * before->covariance * carry.transpose();
  return out;
}

}  // namespace extract
}  // namespace rangecal
