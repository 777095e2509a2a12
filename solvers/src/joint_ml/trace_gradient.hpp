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
#include "rangecal/problems/landmarks/power_law_term.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// M for the line of sight delta = landmark - stop, and the stop's heading h: of (x, y) with the sign of the stop
/// towards h; cov(delta, alpha) where M holds the globals.
struct SightCovariance {
  double xx = 0.0, xy = 0.0, yy = 0.0, xh = 0.0, yh = 0.0, hh = 0.0;
  const double *alpha_x = nullptr, *alpha_y = nullptr;
};

/// tr(C hessian) of one link as a function of its six coordinates; `covariance` holds C for them.
inline double link_trace(const JointProblem& problem, const JointState& state, int k,
                         const ChainLink::Matrix6& covariance, const Eigen::Matrix3d& W,
                         const ChainLink::Vector6& moved) {
  Pose2 from = state.stops[k - 1], to = state.stops[k];
  from.x_m += moved[0];
  from.y_m += moved[1];
  from.heading_rad += moved[2];
  to.x_m += moved[3];
  to.y_m += moved[4];
  to.heading_rad += moved[5];
  const ChainLink link(problem.stops[k - 1], problem.stops[k], from, to);
  return (covariance * link.hessian(W, true)).trace();
}

/// One cell's range share to third order in d: derivatives q1, q2, q3 of q, and per parameter of the curve (alpha, then
/// tau) the first and second derivative in d of dq/dparameter.
struct ThirdOrder {
  ThirdOrder(const JointState& at, const Cells& cells)
      : state(at),
        moved(at),
        na(static_cast<int>(at.alpha.size())),
        is_power(at.noise.law != NoiseLaw::polynomial && at.noise.law != NoiseLaw::d_squared),
        bent(!cells.bend.empty()),
        law{at.noise.power_of_f(), 1.0 / (at.noise.parameters[0] * at.noise.parameters[0])} {}

  void evaluate(double d, const Cells& c, std::size_t i) {
    if (!is_power) {
      general.evaluate(d, c, i, state.alpha, state.noise);
      q1 = general.cost.first();
      q2 = general.cost.second();
      q3 = general.cost.third();
      for (int a = 0; a < na; ++a) {
        const Taylor<3> by_alpha = general.by_alpha(a);
        first[a] = by_alpha.first();
        second[a] = by_alpha.second();
      }
      for (int e = 0; e < general.noise_parameters(); ++e) {
        const Taylor<3> by_tau = general.by_tau(e);
        first[na + e] = by_tau.first();
        second[na + e] = by_tau.second();
      }
      return;
    }
    double f = 0.0, f3 = 0.0;  // Taylor coefficients first, then derivatives
    f1 = f2 = 0.0;
    for (int a = na; a-- > 0;) {
      f3 = f3 * d + f2;
      f2 = f2 * d + f1;
      f1 = f1 * d + f;
      f = f * d + state.alpha[a];
    }
    f2 *= 2.0;
    f3 *= 6.0;
    const double mean = bent ? c.range_mean[i] - c.bent(i, d) : c.range_mean[i];
    const PowerLawTerm term(law, f, c.count[i], c.range_weight[i], mean, c.range_mean_square[i]);
    g1 = term.by_f;
    g2 = term.by_f_f;
    g3 = term.third();
    g1_tau = term.by_f_tau;
    g2_tau = term.by_f_f_tau();
    g1_slope = g2 * f1;
    g2_slope = g3 * f1;
    g1_bend = g2_slope * f1 + g2 * f2;
    g1_tau_slope = g2_tau * f1;
    q1 = g1 * f1;
    q2 = g2 * f1 * f1 + g1 * f2;
    q3 = g3 * f1 * f1 * f1 + 3.0 * g2 * f1 * f2 + g1 * f3;
    double by_tau_slope = g1_tau * f1, by_tau_bend = g2_tau * f1 * f1 + g1_tau * f2;
    if (bent) {  // d/dd = f1 d/df + b d/dg
      const double b = c.bend[i], fg = term.by_f_g(), ffg = term.by_f_f_g(), fgg = term.by_f_g_g();
      q1 += term.by_g() * b;
      q2 += (2.0 * fg * f1 + term.by_g_g() * b) * b;
      q3 += 3.0 * (ffg * f1 * f1 + fgg * f1 * b + fg * f2) * b;
      g1_slope += fg * b;
      g2_slope += ffg * b;
      g1_bend += (2.0 * ffg * f1 + fgg * b) * b;
      g1_tau_slope += term.by_f_g_tau() * b;
      by_tau_slope += term.by_g_tau() * b;
      by_tau_bend += (2.0 * term.by_f_g_tau() * f1 + term.by_g_g_tau() * b) * b;
    }
    double power = 1.0, power_1 = 0.0, power_2 = 0.0;  // d^a and its derivatives
    for (int a = 0; a < na; ++a) {
      first[a] = power_1 * g1 + power * g1_slope;
      second[a] = power_2 * g1 + 2.0 * power_1 * g1_slope + power * g1_bend;
      power_2 = power_2 * d + 2.0 * power_1;
      power_1 = power_1 * d + power;
      power *= d;
    }
    first[na] = by_tau_slope;
    second[na] = by_tau_bend;
  }

  /// After evaluate: what the covariances with alpha add to tr(M H) of the cell,
  ///   E = 2 sum_a d2q/(dd dalpha_a) n_a + sum_ab d2q/(dalpha_a dalpha_b) M_ab,
  /// n_a = n . cov(delta, alpha_a), t_a = t . cov(delta, alpha_a): its derivatives in d, in the turn of n, in the curve.
  struct AlphaTrace {
    double by_d = 0.0, by_turn = 0.0;
    std::array<double, 2 * RangeTerm<3>::max_coefficients> by_curve{};
  };
  void alpha_trace(double d, const Cells& c, std::size_t i, const double* n, const double* t, const double* M,
                   AlphaTrace& out) {
    out.by_turn = 0.0;
    for (int a = 0; a < na; ++a) out.by_turn += 2.0 * first[a] * t[a];
    if (!is_power) {
      differentiate_alpha_trace(d, c, i, n, M, out);
      return;
    }
    // With g1, g2, g3 the cost's derivatives in f: E = 2 (g1' m + g1 m') + g2 w,  m = sum n_a d^a,  w = sum M_ab d^a d^b.
    double power[RangeTerm<3>::max_coefficients], m = 0.0, m1 = 0.0, m2 = 0.0, w = 0.0, w1 = 0.0;
    power[0] = 1.0;
    for (int a = 1; a < na; ++a) power[a] = d * power[a - 1];
    for (int a = 0; a < na; ++a) {
      const double slope = a > 0 ? a * power[a - 1] : 0.0;
      m += n[a] * power[a];
      m1 += n[a] * slope;
      if (a > 1) m2 += n[a] * a * (a - 1) * power[a - 2];
      double row = 0.0;
      for (int b = 0; b < na; ++b) row += M[a * na + b] * power[b];
      w += power[a] * row;
      w1 += 2.0 * slope * row;
    }
    out.by_d = 2.0 * (g1_bend * m + 2.0 * g1_slope * m1 + g1 * m2) + g2_slope * w + g2 * w1;
    const double by_f = 2.0 * (g2_slope * m + g2 * m1) + g3 * w, by_slope = 2.0 * g2 * m;
    for (int a = 0; a < na; ++a)
      out.by_curve[a] = by_f * power[a] + (a > 0 ? by_slope * a * power[a - 1] : 0.0);
    out.by_curve[na] = 2.0 * (g1_tau_slope * m + g1_tau * m1) + g2_tau * w;
  }

  /// The same by central differences of E, for the laws whose derivatives are not written out: smooth, error of order
  /// 1e-10 in parts of it.
  void differentiate_alpha_trace(double d, const Cells& c, std::size_t i, const double* n, const double* M,
                                 AlphaTrace& out) {
    constexpr double part = 1e-5;
    const auto trace = [&](double at) {
      near.evaluate(at, c, i, moved.alpha, moved.noise);
      double sum = 0.0;
      for (int a = 0; a < na; ++a) {
        sum += 2.0 * near.by_alpha(a).first() * n[a];
        for (int b = 0; b < na; ++b)
          sum += near.alpha_alpha * M[a * na + b] * near.power[a].value() * near.power[b].value();
      }
      return sum;
    };
    const auto slope = [&](double& parameter, double step) {
      const double home = parameter;
      parameter = home + step;
      const double up = trace(d);
      parameter = home - step;
      const double down = trace(d);
      parameter = home;
      return (up - down) / (2.0 * step);
    };
    out.by_d = (trace(d * (1.0 + part)) - trace(d * (1.0 - part))) / (2.0 * part * d);
    double power = 1.0;
    for (int a = 0; a < na; ++a, power *= d) out.by_curve[a] = slope(moved.alpha[a], part * d / power);
    const Eigen::Index taus = moved.noise.parameters.size();
    const double spread = state.noise.spread(d, 0.0);
    power = 1.0;
    for (Eigen::Index e = 0; e < taus; ++e, power *= d) {
      double& tau = moved.noise.parameters[e];
      const bool beta = state.noise.law == NoiseLaw::polynomial;
      out.by_curve[na + e] = slope(tau, part * (beta ? spread / power : tau)) * (beta ? 1.0 : tau);
    }
  }

  const JointState& state;
  JointState moved;
  int na;
  bool is_power, bent;
  PowerLaw law;
  RangeTerm<3> general;
  RangeTerm<2> near;
  double f1 = 0.0, f2 = 0.0, g1 = 0.0, g2 = 0.0, g3 = 0.0, g1_tau = 0.0,
         g2_tau = 0.0;                                                       ///< of f in d, and of q in f
  double g1_slope = 0.0, g1_bend = 0.0, g2_slope = 0.0, g1_tau_slope = 0.0;  ///< of these in d
  double q1 = 0.0, q2 = 0.0, q3 = 0.0;
  std::array<double, 2 * RangeTerm<3>::max_coefficients> first{}, second{};
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
    const double bend = information * (1.0 - (length - taped.distance_m) / length) / length;
    const Eigen::Vector2d slope = bend * (t.dot(M * t) * n + 2.0 * n.dot(M * t) * t);
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
        const double bend = (range.q2 - range.q1 * inverse) * inverse;
        double along = range.q3 * nn + bend * tt, across = 2.0 * bend * mixed;
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
    if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k]) {
      Eigen::Matrix3d of_position = information.W;
      of_position(2, 2) = 0.0;
      by_global[layout_.sigma_s] -=
          2.0 * link_trace(problem_, state, k, C, of_position, ChainLink::Vector6::Zero());
    }
    if (at.coordinate[2] < 0 || !prior.turns_add_up) continue;  // the link is linear
    for (int a = 0; a < 6; ++a) {
      if (at.coordinate[a] < 0) continue;
      const double step = 1e-5;  // the trace is a smooth function of order one: error of order step^2
      ChainLink::Vector6 moved = ChainLink::Vector6::Zero();
      moved[a] = step;
      const double up = link_trace(problem_, state, k, C, information.W, moved);
      moved[a] = -step;
      const double down = link_trace(problem_, state, k, C, information.W, moved);
      by_stop[layout_.nodes[at.node_of(a)].coordinate + at.coordinate[a]] += (up - down) / (2.0 * step);
    }
  }
  return 0.5 * (by_global - couple(solve_stops(by_stop)));
}

}  // namespace rangecal
