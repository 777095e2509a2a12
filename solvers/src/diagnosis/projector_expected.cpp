// SPDX-License-Identifier: BSD-3-Clause
// What scores are expected to be where nothing is amiss.
#include <algorithm>
#include <cmath>
#include <utility>

#include "diagnosis/projector.hpp"

namespace rangecal::diagnosis {

/// The likelihood with the stops p integrated out is, by Laplace, F + ln det H / 2 at their optimum: its
/// slope has expectation zero, so that of F in a parameter theta, which changes readings by x(p), has not.
/// With J the slopes and H_c the second derivatives of reading c in its stop, C the covariance of the stop's
/// error,
///   E[x^T W r] = 1/2 d ln det H / d theta = x^T W m + sum_c W_c (dx_c/dp)^T C J_c^T,
///   m = b - J K^-1 (J^T W b + a),   b_c = tr(H_c C) / 2,   a = sum_c W_c H_c C J_c^T.
/// Of each cell it is little; over hundreds of stops it adds up to many standard deviations. Sets m, a and
/// the moved cells; returns the expectation of the slopes in (alpha, landmarks), at their own optimum.
/// (Tierney and Kadane 1986 for the approximation; the slope is this file's.)
Eigen::VectorXd Projector::expect_scores() {
  constexpr double largest_move = 1e-5;  // metres, radians: far below any period, far above rounding
  const JointLayout& layout = system_.layout();
  const Cells& c = problem_.cells;
  const Eigen::Index n = cells();
  expected_.range = expected_.bearing = Eigen::VectorXd::Zero(n);
  curving_.assign(problem_.stops.size(), Eigen::Vector2d::Zero());
  Eigen::VectorXd a = Eigen::VectorXd::Zero(layout.coordinates);
  Eigen::VectorXd of_globals = Eigen::VectorXd::Zero(layout.global_count);
  std::vector<Eigen::MatrixXd> covariance;
  for (std::size_t node = 0; node < layout.nodes.size(); ++node)
    covariance.push_back(layout.nodes[node].dim > 0 ? system_.stop_covariance(static_cast<int>(node))
                                                    : Eigen::MatrixXd());
  Signature b = expected_;
  Eigen::MatrixXd moves(n, 4);  // of d and of the bearing, by errors of ranges and of bearings
  moves.setZero();
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto cell = static_cast<std::size_t>(i);
    const int k = c.stop[cell], node_index = layout.node_of_stop[k], heading_slot = layout.slot_of_stop[k];
    const JointLayout::Node& node = layout.nodes[node_index];
    if (node.dim == 0) continue;
    const Eigen::MatrixXd& C = covariance[node_index];
    const int heading = node.heading[heading_slot];
    const Eigen::Vector2d &normal = geometry_.n[cell], &across = geometry_.t[cell];
    const double rho = geometry_.axis_distance[cell], slope = slope_[i];
    Eigen::VectorXd range_slope = Eigen::VectorXd::Zero(node.dim), bearing_slope = range_slope;  // J
    Eigen::Matrix2d range_curve = Eigen::Matrix2d::Zero(), bearing_curve = range_curve;          // H
    if (node.free_position) {
      range_slope.head<2>() = -slope * normal;
      bearing_slope.head<2>() = -across / rho;
      range_curve =
          slope / rho * across * across.transpose() + geometry_.curvature[cell] * normal * normal.transpose();
      bearing_curve = -(normal * across.transpose() + across * normal.transpose()) / (rho * rho);
    }
    if (heading >= 0) bearing_slope[heading] = -1.0;
    const double information[] = {range_information[i], bearing_information[i]};
    for (const bool by_bearing : {false, true}) {
      const Eigen::VectorXd follows =
          information[by_bearing] * (C * (by_bearing ? bearing_slope : range_slope));
      if (heading >= 0) moves(i, 2 * by_bearing + 1) -= follows[heading];
      if (!node.free_position) continue;
      const Eigen::Vector2d shift = follows.head<2>();
      moves(i, 2 * by_bearing) = -normal.dot(shift);
      moves(i, 2 * by_bearing + 1) -= across.dot(shift) / rho;
      const Eigen::Matrix2d& curve = by_bearing ? bearing_curve : range_curve;
      const Eigen::Vector2d pull = curve * shift;
      curving_[k] += pull;
      a.segment<2>(node.coordinate) += pull;
      of_globals.segment<2>(layout.landmark_begin + 2 * c.landmark[cell]) -= pull;
      (by_bearing ? b.bearing : b.range)[i] = 0.5 * curve.cwiseProduct(C.topLeftCorner<2, 2>()).sum();
    }
    double power = moves(i, 0);  // of the slope d^j in alpha_j
    for (int j = 1; j < layout.alpha_count; ++j, power *= geometry_.u[cell]) of_globals[j] += j * power;
  }
  const double largest = moves.cwiseAbs().maxCoeff();
  if (!(largest > 0.0)) return of_globals;
  step_ = largest_move / largest;
  for (const bool by_bearing : {false, true}) {
    CellGeometry geometry = geometry_;
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto cell = static_cast<std::size_t>(i);
      const double away = step_ * moves(i, 2 * by_bearing);
      geometry.d[cell] += away;
      geometry.u[cell] += away;  // of landmarks, whose curve is one of the distance
      geometry.axis_distance[cell] += away;
      geometry.f[cell] += geometry_.slope[cell] * away;
      geometry.slope[cell] += geometry_.curvature[cell] * away;
      geometry.bearing[cell] += step_ * moves(i, 2 * by_bearing + 1);
    }
    moved_.push_back(std::move(geometry));
  }
  const Signature taken =
      of_calibration(Eigen::VectorXd::Zero(layout.global_count), system_.solve_stops(pulls(b).stops + a));
  expected_.range = b.range - taken.range;
  expected_.bearing = b.bearing - taken.bearing;
  of_globals += pulls(expected_).globals;
  return of_globals;
}

void Projector::set_drift(const Eigen::VectorXd& range, const Eigen::VectorXd& bearing, Signature& x) const {
  constexpr double most_noise = 0.05;  // variance that the slopes' own spread may add to the score's
  x.follows = (range + bearing) / step_;
  x.turns = x.follows.squaredNorm() > most_noise * raw_information(x);
  x.drift = x.follows.sum();
}

}  // namespace rangecal::diagnosis
