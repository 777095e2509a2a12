// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// What is known beforehand about one stop: the law of its error e = (e_x, e_y, e_h) [m, m, rad].
///
///   e ~ N(0, C),   C = D Q D,   D = diag(sigma_xy, sigma_xy, sigma_heading),   Q_xx + Q_yy = 2, Q_hh = 1
///
/// e is pose - commanded in the world's frame; along a random walk that of the step from the stop before, seen in that
/// stop's frame. sigma_xy is the root mean square of both axes: whatever scales a sigma scales C with it. Source: 2021
/// eq. 8, where C = sigma_s^2 I; the rest is ours.
struct StopPrior {
  Pose2 commanded;
  double sigma_xy_m = 0.0;         ///< 0: the position is exact
  double sigma_heading_rad = 0.0;  ///< 0: the heading is exact
  int place = 0;            ///< stops of one place share one position error; places are numbered in order
  bool opens_place = true;  ///< the first stop of its place: the one whose position error has the prior
  bool chained = false;     ///< random walk: the error adds to that of the stop before
  /// Of a random walk: errors of the heading add up too, and a step is seen in the frame of the stop before. False: positions
  /// alone add up, in the world's frame, and every heading has an error of its own.
  bool turns_add_up = true;
  int recording = 0;
  /// Q, positive definite; null: the unit matrix. Of the first stop of a place only: of the others nothing but the heading
  /// has a prior.
  std::shared_ptr<const Eigen::Matrix3d> shape = nullptr;
};

/// sigma_xy, sigma_heading and Q of a covariance; Q is null where it is the unit matrix.
void set_covariance(const Eigen::Matrix3d& covariance, StopPrior& prior);

/// C, with sigma_xy as given [m^2, m rad, rad^2].
Eigen::Matrix3d covariance_of(const StopPrior& prior, double sigma_xy_m);

/// -log p(e) = 1/2 e^T W e + log_scale, over the coordinates that have a prior: position where the stop opens its place and
/// is not exact, heading where that is not exact.
struct StopInformation {
  StopInformation(const StopPrior& prior, double sigma_xy_m);
  /// R with R^T R = W, upper triangular.
  Eigen::Matrix3d root() const;

  bool position, heading;
  Eigen::Matrix3d W;       ///< C^-1; zero in the rows and columns of what has no prior
  double log_scale = 0.0;  ///< 1/2 log det C + k/2 log 2 pi over the k coordinates
};

/// Stops of one place share its position error: where the one that opens it stands says where the others do, as far from it
/// as commanded. `stops`: one per prior.
void share_places(const std::vector<StopPrior>& priors, std::vector<Pose2>& stops);

/// An error of this law from three of N(0, 1): C^(1/2) u. All coordinates, whether the stop opens its place or not.
Eigen::Vector3d stop_error(const StopPrior& prior, double sigma_xy_m, const Eigen::Vector3d& unit);

}  // namespace rangecal
