// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <cmath>

#include "rangecal/core/angles.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// One link of a random walk: the increment from stop 0 to stop 1, seen in the frame of stop 0, against the
/// commanded one.
///
///   r = R(-h0) (p1 - p0) - R(-h0c) (p1c - p0c)   [m],   t = (h1 - h0) - (h1c - h0c)   [rad]
///   cost = |r|^2 / (2 sigma_xy^2) + t^2 / (2 sigma_h^2) (+ logs)
///
/// Six coordinates in the order (x0, y0, h0, x1, y1, h1). Source: 2021 eq. 7 with the error of one step in the
/// robot's frame; with exact headings it is the world's frame.
struct ChainLink {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;

  ChainLink(const StopPrior& before, const StopPrior& after, const Pose2& from, const Pose2& to) {
    const Eigen::Vector2d step(to.x_m - from.x_m, to.y_m - from.y_m);
    const Eigen::Vector2d commanded(after.commanded.x_m - before.commanded.x_m,
                                    after.commanded.y_m - before.commanded.y_m);
    back = Eigen::Rotation2Dd(-from.heading_rad).toRotationMatrix();
    seen = back * step;
    residual = seen - Eigen::Rotation2Dd(-before.commanded.heading_rad) * commanded;
    turn = wrap_angle(to.heading_rad - from.heading_rad - after.commanded.heading_rad + before.commanded.heading_rad);
  }

  /// dr/d(x0, y0, h0, x1, y1, h1)
  Eigen::Matrix<double, 2, 6> jacobian() const {
    Eigen::Matrix<double, 2, 6> j = Eigen::Matrix<double, 2, 6>::Zero();
    j.leftCols<2>() = -back;
    j.middleCols<2>(3) = back;
    j.col(2) = Eigen::Vector2d(seen.y(), -seen.x());  // dR(-h)/dh x = (y, -x) of the rotated vector
    return j;
  }

  /// Hessian of the cost with position information w_xy and heading information w_h; `exact` adds the curvature.
  Matrix6 hessian(double w_xy, double w_h, bool exact) const {
    const Eigen::Matrix<double, 2, 6> j = jacobian();
    Matrix6 h = w_xy * j.transpose() * j;
    if (exact) {
      h(2, 2) -= w_xy * residual.dot(seen);
      // d2r/dh0 dp = the same turn applied to the columns of the p-Jacobian
      Eigen::Matrix2d turned;
      turned << back.row(1), -back.row(0);
      const Eigen::RowVector2d cross = w_xy * residual.transpose() * turned;
      h.block<1, 2>(2, 3) += cross;
      h.block<2, 1>(3, 2) += cross.transpose();
      h.block<1, 2>(2, 0) -= cross;
      h.block<2, 1>(0, 2) -= cross.transpose();
    }
    h(2, 2) += w_h;
    h(5, 5) += w_h;
    h(2, 5) -= w_h;
    h(5, 2) -= w_h;
    return h;
  }

  Eigen::Matrix2d back;
  Eigen::Vector2d seen, residual;
  double turn;
};

/// The node coordinate of each of the six link coordinates, -1 where it is not free; first three belong to `node0`.
struct LinkCoordinates {
  LinkCoordinates(const JointLayout& layout, int stop) {
    node0 = layout.node_of_stop[stop - 1];
    node1 = layout.node_of_stop[stop];
    const JointLayout::Node &a = layout.nodes[node0], &b = layout.nodes[node1];
    const int h0 = a.heading[layout.slot_of_stop[stop - 1]], h1 = b.heading[layout.slot_of_stop[stop]];
    coordinate = {a.free_position ? 0 : -1, a.free_position ? 1 : -1, h0, b.free_position ? 0 : -1,
                  b.free_position ? 1 : -1, h1};
  }
  int node_of(int i) const { return i < 3 ? node0 : node1; }

  int node0, node1;
  std::array<int, 6> coordinate;
};

}  // namespace rangecal
