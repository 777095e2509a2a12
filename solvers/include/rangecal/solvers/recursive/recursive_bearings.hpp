// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "rangecal/solvers/closed_form/landmarks_from_bearings.hpp"

namespace rangecal {

/// One landmark from its lines of sight, taken one at a time (2021 eq. 18-25, weights `consistent`): a line
/// from the commanded stop s in the world direction phi is the row (sin phi, -cos phi | (sin phi, -cos phi)
/// (s - origin)) times 1 / sqrt(sigma_s^2 + (sigma_theta^2 / R + sigma_h^2) d^2). Givens rotations take it
/// into the triangle
///
///   S = [ R  z   ],   R (m - origin) = z,   (R^T R)^-1 the covariance [m^2],
///       [ 0  rho ]
///
/// the square-root information form of landmarks_from_bearings, and its answer to rounding. The origin is the
/// first stop.
class RecursiveBearings {
 public:
  struct Line {
    Eigen::Vector2d stop_m;      ///< commanded
    double direction_rad = 0.0;  ///< phi: heading and mean bearing
    double distance_m = 0.0;     ///< d: the measured one, to the axis
    double repeats = 1.0;        ///< R
    double sigma_s_m = 0.0, sigma_heading_rad = 0.0, sigma_theta_rad = 0.0;
  };

  /// Cost: 20 ns.
  void add(const Line& line);
  /// Outcomes and reasons as landmarks_from_bearings; lines that meet behind the stops are told by the sum of
  /// their lengths, not by their number.
  LandmarkFromBearings landmark() const;

  /// Everything there is, in a fixed order, and back.
  static constexpr int state_size = 16;
  std::array<double, state_size> state() const;
  void restore(const std::array<double, state_size>& state);

 private:
  double lines_ = 0.0;
  Eigen::Matrix3d triangle_ = Eigen::Matrix3d::Zero();
  Eigen::Vector2d origin_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d along_ = Eigen::Vector2d::Zero();   ///< sum of the lines' directions
  double along_stop_ = 0.0;                           ///< sum of direction . (stop - origin)
  double noise_sq_ = 0.0;                             ///< sum of what would turn parallel lines [rad^2]
  Eigen::Vector3d spread_ = Eigen::Vector3d::Zero();  ///< xx, xy, yy of the sum of rows, unweighted
};

}  // namespace rangecal
