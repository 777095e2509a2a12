// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/recursive_bearings.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>

#include "recursive/take_row.hpp"

namespace rangecal {

using Eigen::Matrix2d;
using Eigen::Vector2d;

void RecursiveBearings::add(const Line& line) {
  const Vector2d along(std::cos(line.direction_rad), std::sin(line.direction_rad)),
      across(along.y(), -along.x());
  if (lines_ == 0.0) origin_ = line.stop_m;
  const Vector2d stop = line.stop_m - origin_;
  const double d_sq = line.distance_m * line.distance_m, s_sq = line.sigma_s_m * line.sigma_s_m;
  const double turn_sq = line.sigma_theta_rad * line.sigma_theta_rad / line.repeats +
                         line.sigma_heading_rad * line.sigma_heading_rad;
  const double root = 1.0 / std::sqrt(std::max(s_sq + turn_sq * d_sq, 1e-300));
  Eigen::Matrix<double, 4, 3> rows;
  rows.topRows<3>() = triangle_;
  rows.row(3) << root * across.x(), root * across.y(), root * across.dot(stop);
  take_last_row(rows);
  triangle_ = rows.topRows<3>();
  lines_ += 1.0;
  along_ += along;
  along_stop_ += along.dot(stop);
  noise_sq_ += s_sq / d_sq + turn_sq;
  spread_ += Eigen::Vector3d(across.x() * across.x(), across.x() * across.y(), across.y() * across.y());
}

LandmarkFromBearings RecursiveBearings::landmark() const {
  LandmarkFromBearings result;
  result.cells = static_cast<int>(std::min(lines_, 2e9));
  const auto open = [&](const char* why, const Vector2d& direction) {
    result.weakest_direction = direction;
    result.outcome = Outcome::unobservable;
    result.reason =
        fmt::format("{}: not determined along ({:.3f}, {:.3f})", why, direction.x(), direction.y());
    return result;
  };
  result.condition = std::numeric_limits<double>::infinity();
  if (lines_ == 0.0) {
    result.outcome = Outcome::too_few_data;
    result.reason = "never seen";
    return result;
  }
  if (lines_ < 2.0) return open("seen from one stop only", along_);
  Matrix2d spread;
  spread << spread_[0], spread_[1], spread_[1], spread_[2];
  const Matrix2d R = triangle_.topLeftCorner<2, 2>().triangularView<Eigen::Upper>(), A = R.transpose() * R;
  Eigen::SelfAdjointEigenSolver<Matrix2d> of_spread, of_A;
  of_spread.computeDirect(Matrix2d(spread / lines_));
  of_A.computeDirect(A);
  if (of_A.eigenvalues()(0) > 0.0)
    result.condition = std::sqrt(of_A.eigenvalues()(1) / of_A.eigenvalues()(0));
  if (of_spread.eigenvalues()(0) < std::max(1e-13, 2.25 * noise_sq_ / lines_))
    return open("its lines of sight are parallel", of_spread.eigenvectors().col(0));
  result.weakest_direction = of_A.eigenvectors().col(0);
  const Vector2d from_origin = R.triangularView<Eigen::Upper>().solve(Vector2d(triangle_.col(2).head<2>()));
  if (along_.dot(from_origin) <= along_stop_)
    return open("its lines of sight meet behind the stops", result.weakest_direction);
  const Matrix2d root = R.triangularView<Eigen::Upper>().solve(Matrix2d(Matrix2d::Identity()));
  result.position_m = origin_ + from_origin;
  result.covariance = root * root.transpose();
  result.outcome = Outcome::converged;
  return result;
}

std::array<double, RecursiveBearings::state_size> RecursiveBearings::state() const {
  std::array<double, state_size> all{lines_,     noise_sq_,  along_stop_, origin_.x(), origin_.y(),
                                     along_.x(), along_.y(), spread_[0],  spread_[1],  spread_[2]};
  std::size_t at = 10;
  for (int i = 0; i < 3; ++i)
    for (int j = i; j < 3; ++j) all[at++] = triangle_(i, j);
  return all;
}

void RecursiveBearings::restore(const std::array<double, state_size>& all) {
  lines_ = all[0];
  noise_sq_ = all[1];
  along_stop_ = all[2];
  origin_ = {all[3], all[4]};
  along_ = {all[5], all[6]};
  spread_ = {all[7], all[8], all[9]};
  std::size_t at = 10;
  for (int i = 0; i < 3; ++i)
    for (int j = i; j < 3; ++j) triangle_(i, j) = all[at++];
}

}  // namespace rangecal
