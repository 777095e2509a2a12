// SPDX-License-Identifier: BSD-3-Clause
// The gradient of 1/2 tr(M H), M held: with M = C = H_ss^-1 that of 1/2 log det H_ss, with M what the globals' own
// uncertainty adds to C that of 1/2 log det of the Schur complement. A sum over cells, links and taped distances; the
// stops follow by the implicit function theorem.
#pragma once

#include <array>
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "joint_ml/chain_link.hpp"
#include "joint_ml/joint_accumulator.hpp"
#include "joint_ml/third_order.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// M for the line of sight delta = landmark - stop, and the stop's heading h: of (x, y) with the sign of the stop
/// towards h; cov(delta, alpha) where M holds the globals.
struct SightCovariance {
  double xx = 0.0, xy = 0.0, yy = 0.0, xh = 0.0, yh = 0.0, hh = 0.0;
  const double *alpha_x = nullptr, *alpha_y = nullptr;
};

/// What the taped distances between landmarks add.
template <typename Covariance>
void JointSystem::add_taped_trace(const JointState& state, const Covariance& covariance,
                                  Eigen::VectorXd& by_global) const {
  for (const KnownDistance& taped : problem_.known_distances) {
    const Eigen::Vector2d v = state.landmarks[taped.to] - state.landmarks[taped.from];
    const int a = layout_.landmark_begin + 2 * taped.from, b = layout_.landmark_begin + 2 * taped.to;
    Eigen::Matrix2d M;
    for (int i = 0; i < 2; ++i)
      for (int j = 0; j < 2; ++j)
        M(i, j) = covariance.landmarks(b + i, b + j) + covariance.landmarks(a + i, a + j) -
                  covariance.landmarks(a + i, b + j) - covariance.landmarks(b + i, a + j);
    const double length = v.norm(), information = 1.0 / (taped.sigma_m * taped.sigma_m);
    const Eigen::Vector2d n = v / length, t(-n.y(), n.x());
    const double effect_slope = information * (1.0 - (length - taped.distance_m) / length) / length;
    const Eigen::Vector2d slope = effect_slope * (t.dot(M * t) * n + 2.0 * n.dot(M * t) * t);
    by_global.segment<2>(a) -= slope;
    by_global.segment<2>(b) += slope;
  }
}

template <typename Covariance>
Eigen::VectorXd JointSystem::trace_gradient(const JointState& state, Covariance& covariance) const {
  const Cells& c = problem_.cells;
  const int na = layout_.alpha_count, nt = layout_.tau_count;
  Eigen::VectorXd by_global = Eigen::VectorXd::Zero(layout_.global_count);
  Eigen::VectorXd by_stop = Eigen::VectorXd::Zero(layout_.coordinates);
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  ThirdOrder range(state, c);
  ThirdOrder::AlphaTrace extra;
  SightCovariance of;
  std::array<double, 2 * RangeTerm<3>::max_coefficients> by_curve{};

  for (const JointLayout::Node& node : layout_.nodes) {
    covariance.enter(node);
    const bool moves = node.free_position;
    double* const own = by_stop.data() + node.coordinate;
    for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
      const int k = node.stops[slot], heading = node.heading[slot];
      const Pose2& pose = state.stops[k];
      const double ch = pose.heading_rad == 0.0 ? 1.0 : std::cos(pose.heading_rad);
      const double sh = pose.heading_rad == 0.0 ? 0.0 : std::sin(pose.heading_rad);
      if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k] && problem_.stops[k].opens_place &&
          !problem_.stops[k].chained) {
        const double sigma = *state.sigma_s_m;
        by_global[layout_.sigma_s] -= 2.0 * covariance.position_trace() / (sigma * sigma);
      }
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
        const Eigen::Vector2d& axis = state.landmarks[c.landmark[i]];
        const double vx = axis.x() - pose.x_m, vy = axis.y() - pose.y_m, D = std::sqrt(vx * vx + vy * vy);
        const double inverse = 1.0 / D, inverse_sq = inverse * inverse, nx = vx * inverse, ny = vy * inverse;
        const double d = D - c.radius_m[i];
        range.evaluate(d, c, i);
        covariance.cell(heading, c.landmark[i], layout_.slot_of(node, i), of);
        // C along n = (nx, ny) and across t = (-ny, nx).
        const double nn = of.xx * nx * nx + 2.0 * of.xy * nx * ny + of.yy * ny * ny, tt = of.xx + of.yy - nn;
        const double mixed = (of.yy - of.xx) * nx * ny + of.xy * (nx * nx - ny * ny);
        const double n_h = nx * of.xh + ny * of.yh, t_h = nx * of.yh - ny * of.xh;
        // Range: trace = q2 nn + q1/D tt; n turns by 1/D per metre across.
        const double effect_slope = (range.q2 - range.q1 * inverse) * inverse;
        double along = range.q3 * nn + effect_slope * tt, across = 2.0 * effect_slope * mixed;
        // Bearing: trace = w tt/D^2 + 2 w r mixed/D^2 + w hh + 2 w t_h/D, r the bearing error.
        const double w = c.bearing_weight[i] * bearing_information;
        const double cb = bearing_direction_[2 * i], sb = bearing_direction_[2 * i + 1];
        const double r = bearing_error(cb * ch - sb * sh, sb * ch + cb * sh, vx, vy);
        const double turned = inverse_sq * (tt + 2.0 * r * mixed);
        along -= 2.0 * w * (inverse * turned + inverse_sq * t_h);
        // across: dn = t/D, dt = -n/D, dr = -1/D
        across += w * inverse_sq * (inverse * (-4.0 * mixed + 2.0 * r * (tt - nn)) - 2.0 * n_h);
        const double side = inverse * tt;
        for (int e = 0; e < na + nt; ++e) by_curve[e] += range.second[e] * nn + range.first[e] * side;
        if constexpr (Covariance::with_alpha) {
          double n_alpha[RangeTerm<3>::max_coefficients], t_alpha[RangeTerm<3>::max_coefficients];
          for (int a = 0; a < na; ++a) {
            n_alpha[a] = nx * of.alpha_x[a] + ny * of.alpha_y[a];
            t_alpha[a] = nx * of.alpha_y[a] - ny * of.alpha_x[a];
          }
          range.alpha_trace(d, c, i, n_alpha, t_alpha, covariance.alpha_alpha(), extra);
          along += extra.by_d;
          across += extra.by_turn * inverse;
          for (int e = 0; e < na + nt; ++e) by_curve[e] += extra.by_curve[e];
        }
        const double sx = along * nx - across * ny, sy = along * ny + across * nx;
        double* const landmark = by_global.data() + layout_.landmark_begin + 2 * c.landmark[i];
        landmark[0] += sx;
        landmark[1] += sy;
        if (moves) {
          own[0] -= sx;
          own[1] -= sy;
        }
        if (heading >= 0) own[heading] += 2.0 * w * inverse_sq * mixed;  // dr/dh = 1
        by_global[layout_.sigma_theta] -=
            2.0 * w * (inverse_sq * (tt + 2.0 * r * mixed) + of.hh + 2.0 * inverse * t_h);
      }
    }
  }

  for (int a = 0; a < na; ++a) by_global[a] += by_curve[a];
  for (int e = 0; e < nt; ++e) by_global[layout_.tau_begin + e] += by_curve[na + e];
  add_taped_trace(state, covariance, by_global);

  for (int k = 1; layout_.chained && k < problem_.stop_count(); ++k) {
    const StopPrior& prior = problem_.stops[k];
    if (!prior.chained || !prior.opens_place) continue;
    const LinkCoordinates at(layout_, k);
    if (!layout_.nodes[at.node1].free_position) continue;
    ChainLink::Matrix6 C = ChainLink::Matrix6::Zero();
    for (int a = 0; a < 6; ++a)
      for (int e = 0; e < 6; ++e)
        if (at.coordinate[a] >= 0 && at.coordinate[e] >= 0)
          C(a, e) = covariance.between(at.node_of(a), at.coordinate[a], at.node_of(e), at.coordinate[e]);
    const StopInformation information(prior, sigma_xy_of(problem_, state, k));
    const ChainLink link(problem_.stops[k - 1], prior, state.stops[k - 1], state.stops[k]);
    if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k]) {
      Eigen::Matrix3d of_position = information.W;
      of_position(2, 2) = 0.0;
      by_global[layout_.sigma_s] -= 2.0 * (C * link.hessian(of_position, true)).trace();
    }
    if (at.coordinate[2] < 0 || !prior.turns_add_up) continue;  // the link is linear
    const ChainLink::Vector6 slope = link.trace_gradient(C, information.W);
    for (int a = 0; a < 6; ++a)
      if (at.coordinate[a] >= 0)
        by_stop[layout_.nodes[at.node_of(a)].coordinate + at.coordinate[a]] += slope[a];
  }
  return 0.5 * (by_global - couple(solve_stops(by_stop)));
}

}  // namespace rangecal
