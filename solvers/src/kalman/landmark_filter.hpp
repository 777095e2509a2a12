// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// What a calibration, the stops' priors and the readings so far say of the next reading of a landmark: the extended
/// Kalman filter over x = (alpha, pose of the stop, landmarks), alpha with the covariance of the calibration.
///
///   range    y = f(d) + s(d) e,   d = |m - p| - radius       dy/dalpha_i = d^i, dy/dm = -dy/dp = f'(d) n
///   bearing  theta = atan2(m - p) - h + nu                   dtheta/dm = -dtheta/dp = t / |m - p|, dtheta/dh = -1
///
/// n the direction from stop to landmark, t across it. Readings are taken one number after the other: the innovations
/// over their standard deviations, nu / sqrt(S), are then independent N(0, 1) if nothing has changed. A landmark seen
/// for the first time is put where its reading says it is, with the covariance of that; while the curve has no distance
/// for its readings (invert_near) it stays unknown. Each stop has its own prior, or along a random walk the pose before
/// and the step. A number more than 1e3 sqrt(S) off is an innovation like any other, but the state does not follow it
/// (its gain is 0). Source: Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation,
/// 2001, ch. 10.3.
struct LandmarkFilter {
  explicit LandmarkFilter(const Calibration& reference);

  /// A stop with the covariance of its pose's error, or of its step's (`walk`); `turned`: on the spot of the stop
  /// before. Returns F, how the pose's error goes on from that of the stop before: e <- F e + its own.
  Eigen::Matrix3d start(const Pose2& commanded, const Eigen::Matrix3d& covariance, bool walk, bool turned);

  /// One number that was read.
  struct Innovation {
    double nu = 0.0, S = 1.0;  ///< innovation and its variance
    double noise = 0.0;        ///< the reading's own share of S
    Eigen::VectorXd row, gain;
  };
  /// One reading; not usable where no distance goes with it, or it is 1e100 standard deviations off. Of a landmark seen
  /// for the first time, m = m(x, y, theta), there are no innovations but how it was placed: dm/dx, dm/dy.
  struct Taken {
    bool usable = false, placed = false;
    double d = 0.0, f = 0.0, s = 0.0;  ///< as predicted
    Innovation bearing, range;
    Eigen::Matrix2Xd by_state;
    Eigen::Vector2d by_range = Eigen::Vector2d::Zero();
  };
  Taken take(const std::string& landmark, double radius_m, double range_m, double bearing_rad);

  Calibration reference;
  std::vector<std::string> labels;
  std::vector<double> radius_m;
  Pose2 commanded;  ///< of the stop
  Eigen::VectorXd x;
  Eigen::MatrixXd P;

  Eigen::Index pose() const { return reference.alpha.size(); }

 private:
  Taken place(const std::string& landmark, double radius, double range_m, double bearing_rad);
  bool update(Innovation& read);  ///< false, and nothing is done, where nu / sqrt(S) cannot be counted
};

}  // namespace rangecal
