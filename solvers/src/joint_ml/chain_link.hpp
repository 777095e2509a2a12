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
///   cost = e^T W e / 2 (+ logs),  e = (r, t),  W = C^-1: diag(sigma_xy^-2, sigma_xy^-2, sigma_h^-2) or the
///   step's own
///
/// Where headings do not add up: r = (p1 - p0) - (p1c - p0c), t = h1 - h1c.
/// Six coordinates in the order (x0, y0, h0, x1, y1, h1). Source: 2021 eq. 7 with the error of one step in
/// the robot's frame; with exact headings it is the world's frame.
struct ChainLink {
  using Vector6 = Eigen::Matrix<double, 6, 1>;
  using Matrix6 = Eigen::Matrix<double, 6, 6>;

  ChainLink(const StopPrior& before, const StopPrior& after, const Pose2& from, const Pose2& to) {
    const Eigen::Vector2d step(to.x_m - from.x_m, to.y_m - from.y_m);
    const Eigen::Vector2d commanded(after.commanded.x_m - before.commanded.x_m,
                                    after.commanded.y_m - before.commanded.y_m);
    if (!after.turns_add_up) {
      turns = false;
      back.setIdentity();
      seen = step;
      residual = step - commanded;
      turn = wrap_angle(to.heading_rad - after.commanded.heading_rad);
      return;
    }
    back = Eigen::Rotation2Dd(-from.heading_rad).toRotationMatrix();
    seen = back * step;
    residual = seen - Eigen::Rotation2Dd(-before.commanded.heading_rad) * commanded;
    turn = wrap_angle(to.heading_rad - from.heading_rad - after.commanded.heading_rad +
                      before.commanded.heading_rad);
  }

  /// e = (r, t)
  Eigen::Vector3d error() const { return {residual.x(), residual.y(), turn}; }

  /// de/d(x0, y0, h0, x1, y1, h1)
  Eigen::Matrix<double, 3, 6> jacobian() const {
    Eigen::Matrix<double, 3, 6> j = Eigen::Matrix<double, 3, 6>::Zero();
    j.topLeftCorner<2, 2>() = -back;
    j.block<2, 2>(0, 3) = back;
    j(2, 5) = 1.0;
    if (!turns) return j;
    j.block<2, 1>(0, 2) =
        Eigen::Vector2d(seen.y(), -seen.x());  // dR(-h)/dh x = (y, -x) of the rotated vector
    j(2, 2) = -1.0;
    return j;
  }

  /// Hessian of the cost; `exact` adds the curvature.
  Matrix6 hessian(const Eigen::Matrix3d& W, bool exact) const {
    const Eigen::Matrix<double, 3, 6> j = jacobian();
    Matrix6 h = j.transpose() * W * j;
    if (exact && turns) {
      const Eigen::Vector2d pull = (W * error()).head<2>();
      h(2, 2) -= pull.dot(seen);
      // d2r/dh0 dp = the same turn applied to the columns of the p-Jacobian
      Eigen::Matrix2d turned;
      turned << back.row(1), -back.row(0);
      const Eigen::RowVector2d cross = pull.transpose() * turned;
      h.block<1, 2>(2, 3) += cross;
      h.block<2, 1>(3, 2) += cross.transpose();
      h.block<1, 2>(2, 0) -= cross;
      h.block<2, 1>(0, 2) -= cross.transpose();
    }
    return h;
  }

  /// d/dx tr(C H), H the exact Hessian of the cost, C symmetric and held.
  Vector6 trace_gradient(const Matrix6& C, const Eigen::Matrix3d& W) const {
    Vector6 slope = Vector6::Zero();
    if (!turns) return slope;
    const Eigen::Matrix<double, 3, 6> J = jacobian(), JC = J * C;
    const Eigen::Vector2d pull = (W * error()).head<2>();
    const Eigen::RowVector2d to_landing = 2.0 * (C.block<1, 2>(2, 3) - C.block<1, 2>(2, 0));
    Eigen::Matrix2d turned;  // d back / dh0; turned once more it is -back
    turned << back.row(1), -back.row(0);
    for (int a = 0; a < 6; ++a) {
      const Eigen::Vector2d seen_slope = J.col(a).head<2>(), pull_slope = (W * J.col(a)).head<2>();
      Eigen::Matrix<double, 3, 6> J_slope = Eigen::Matrix<double, 3, 6>::Zero();
      J_slope.block<2, 1>(0, 2) = Eigen::Vector2d(seen_slope.y(), -seen_slope.x());
      Eigen::RowVector2d cross_slope = pull_slope.transpose() * turned;
      if (a == 2) {
        J_slope.topLeftCorner<2, 2>() = -turned;
        J_slope.block<2, 2>(0, 3) = turned;
        cross_slope -= pull.transpose() * back;
      }
      slope[a] = 2.0 * (W * J_slope).cwiseProduct(JC).sum()  // tr(C J^T W J)
                 - C(2, 2) * (pull_slope.dot(seen) + pull.dot(seen_slope)) + cross_slope.dot(to_landing);
    }
    return slope;
  }

  Eigen::Matrix2d back;
  Eigen::Vector2d seen, residual;
  double turn;
  bool turns = true;  ///< the heading of stop 0 counts; else the link is linear
};

/// The node coordinate of each of the six link coordinates, -1 where it is not free; first three belong to `node0`.
struct LinkCoordinates {
  LinkCoordinates(const JointLayout& layout, int stop) {
    node0 = layout.node_of_stop[stop - 1];
    node1 = layout.node_of_stop[stop];
    const JointLayout::Node &a = layout.nodes[node0], &b = layout.nodes[node1];
    const int h0 = a.heading[layout.slot_of_stop[stop - 1]], h1 = b.heading[layout.slot_of_stop[stop]];
    coordinate = {a.free_position ? 0 : -1, a.free_position ? 1 : -1, h0,
                  b.free_position ? 0 : -1, b.free_position ? 1 : -1, h1};
  }
  int node_of(int i) const { return i < 3 ? node0 : node1; }

  int node0, node1;
  std::array<int, 6> coordinate;
};

}  // namespace rangecal
