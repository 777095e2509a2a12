// SPDX-License-Identifier: BSD-3-Clause
// The gradient of 1/2 log det H_ss, which Laplace's method adds to the joint NLL. With C = H_ss^-1 held,
// d(1/2 log det H) = 1/2 tr(C dH), a sum over cells and links; the stops follow by the implicit function theorem.
#include <array>
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "joint_ml/chain_link.hpp"
#include "joint_ml/joint_accumulator.hpp"
#include "rangecal/problems/landmarks/power_law_term.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

/// tr(C hessian) of one link as a function of its six coordinates; `covariance` holds C for them.
double link_trace(const JointProblem& problem, const JointState& state, int k, const ChainLink::Matrix6& covariance,
                  double w_xy, const ChainLink::Vector6& moved) {
  Pose2 from = state.stops[k - 1], to = state.stops[k];
  from.x_m += moved[0];
  from.y_m += moved[1];
  from.heading_rad += moved[2];
  to.x_m += moved[3];
  to.y_m += moved[4];
  to.heading_rad += moved[5];
  const ChainLink link(problem.stops[k - 1], problem.stops[k], from, to);
  return (covariance * link.hessian(w_xy, 0.0, true)).trace();
}

/// One cell's range share to third order in d: derivatives q1, q2, q3 of q, and per parameter of the curve (alpha, then
/// tau) the first and second derivative in d of dq/dparameter.
struct ThirdOrder {
  explicit ThirdOrder(const JointState& at)
      : state(at), na(static_cast<int>(at.alpha.size())),
        is_power(at.noise.law != NoiseLaw::polynomial && at.noise.law != NoiseLaw::d_squared),
        law{at.noise.power_of_f(), 1.0 / (at.noise.parameters[0] * at.noise.parameters[0])} {}

  void evaluate(double d, const Cells& c, std::size_t i) {
    if (!is_power) {
      general.evaluate(d, c.count[i], c.range_weight[i], c.range_mean[i], c.range_mean_square[i], state.alpha, state.noise);
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
    double f = 0.0, f1 = 0.0, f2 = 0.0, f3 = 0.0;  // Taylor coefficients first, then derivatives
    for (int a = na; a-- > 0;) {
      f3 = f3 * d + f2;
      f2 = f2 * d + f1;
      f1 = f1 * d + f;
      f = f * d + state.alpha[a];
    }
    f2 *= 2.0;
    f3 *= 6.0;
    const PowerLawTerm term(law, f, c.count[i], c.range_weight[i], c.range_mean[i], c.range_mean_square[i]);
    const double g1 = term.by_f, g2 = term.by_f_f, g3 = term.third(), g2_slope = g3 * f1 * f1 + g2 * f2;
    q1 = g1 * f1;
    q2 = g2 * f1 * f1 + g1 * f2;
    q3 = g3 * f1 * f1 * f1 + 3.0 * g2 * f1 * f2 + g1 * f3;
    double power = 1.0, power_1 = 0.0, power_2 = 0.0;  // d^a and its derivatives
    for (int a = 0; a < na; ++a) {
      first[a] = power_1 * g1 + power * g2 * f1;
      second[a] = power_2 * g1 + 2.0 * power_1 * g2 * f1 + power * g2_slope;
      power_2 = power_2 * d + 2.0 * power_1;
      power_1 = power_1 * d + power;
      power *= d;
    }
    first[na] = term.by_f_tau * f1;
    second[na] = term.by_f_f_tau() * f1 * f1 + term.by_f_tau * f2;
  }

  const JointState& state;
  int na;
  bool is_power;
  PowerLaw law;
  RangeTerm<3> general;
  double q1 = 0.0, q2 = 0.0, q3 = 0.0;
  std::array<double, 2 * RangeTerm<3>::max_coefficients> first{}, second{};
};

/// Expected information of one cell's readings about d, for a law of one parameter.
double expected_information(const JointState& state, double d, const Cells& c, std::size_t i) {
  double f = 0.0, slope = 0.0;
  for (Eigen::Index a = state.alpha.size(); a-- > 0;) {
    slope = slope * d + f;
    f = f * d + state.alpha[a];
  }
  const double s = state.noise.spread(d, f);
  const int power = state.noise.power_of_f();
  const double log_slope = state.noise.law == NoiseLaw::d_squared ? 2.0 / d : power > 0 ? power * slope / f : 0.0;
  return c.range_weight[i] * slope * slope / (s * s) + 2.0 * c.count[i] * log_slope * log_slope;
}

}  // namespace

Eigen::VectorXd JointSystem::log_det_gradient(const JointState& state) const {
  selected_inverse();
  const Cells& c = problem_.cells;
  const int na = layout_.alpha_count, nt = layout_.tau_count;
  Eigen::VectorXd by_global = Eigen::VectorXd::Zero(layout_.global_count);
  Eigen::VectorXd by_stop = Eigen::VectorXd::Zero(layout_.coordinates);
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  ThirdOrder range(state);

  for (const JointLayout::Node& node : layout_.nodes) {
    const double* C = inverse_diagonal_.data() + node.square;
    const int dim = node.dim;
    const bool moves = node.free_position;
    const double cxx = moves ? C[0] : 0.0, cxy = moves ? C[1] : 0.0, cyy = moves ? C[dim + 1] : 0.0;
    double* const own = by_stop.data() + node.coordinate;
    for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
      const int k = node.stops[slot], heading = node.heading[slot];
      const Pose2& pose = state.stops[k];
      const double ch = std::cos(pose.heading_rad), sh = std::sin(pose.heading_rad);
      const double cxh = moves && heading >= 0 ? C[heading * dim] : 0.0;
      const double cyh = moves && heading >= 0 ? C[heading * dim + 1] : 0.0;
      const double turn_variance = heading >= 0 ? C[heading * dim + heading] : 0.0;
      if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k] && problem_.stops[k].opens_place &&
          !problem_.stops[k].chained) {
        const double sigma = *state.sigma_s_m;
        by_global[layout_.sigma_s] -= 2.0 * (cxx + cyy) / (sigma * sigma);
      }
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
        const Eigen::Vector2d& axis = state.landmarks[c.landmark[i]];
        const double vx = axis.x() - pose.x_m, vy = axis.y() - pose.y_m, D = std::sqrt(vx * vx + vy * vy);
        const double inverse = 1.0 / D, inverse_sq = inverse * inverse, nx = vx * inverse, ny = vy * inverse;
        range.evaluate(D - c.radius_m[i], c, i);
        // C along n = (nx, ny) and across t = (-ny, nx).
        const double nn = cxx * nx * nx + 2.0 * cxy * nx * ny + cyy * ny * ny, tt = cxx + cyy - nn;
        const double mixed = (cyy - cxx) * nx * ny + cxy * (nx * nx - ny * ny);
        const double n_h = nx * cxh + ny * cyh, t_h = nx * cyh - ny * cxh;
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
        const double sx = along * nx - across * ny, sy = along * ny + across * nx;
        double* const landmark = by_global.data() + layout_.landmark_begin + 2 * c.landmark[i];
        landmark[0] += sx;
        landmark[1] += sy;
        if (moves) {
          own[0] -= sx;
          own[1] -= sy;
        }
        if (heading >= 0) own[heading] += 2.0 * w * inverse_sq * mixed;  // dr/dh = 1
        by_global[layout_.sigma_theta] -= 2.0 * w * (inverse_sq * (tt + 2.0 * r * mixed) + turn_variance + 2.0 * inverse * t_h);
        const double side = inverse * tt;
        for (int e = 0; e < na; ++e) by_global[e] += range.second[e] * nn + range.first[e] * side;
        for (int e = 0; e < nt; ++e)
          by_global[layout_.tau_begin + e] += range.second[na + e] * nn + range.first[na + e] * side;
      }
    }
  }

  for (int k = 1; layout_.chained && k < problem_.stop_count(); ++k) {
    const StopPrior& prior = problem_.stops[k];
    if (!prior.chained || !prior.opens_place) continue;
    const LinkCoordinates at(layout_, k);
    if (!layout_.nodes[at.node1].free_position) continue;
    ChainLink::Matrix6 covariance = ChainLink::Matrix6::Zero();
    for (int a = 0; a < 6; ++a)
      for (int e = 0; e < 6; ++e) {
        const int p = at.coordinate[a], q = at.coordinate[e];
        if (p < 0 || q < 0) continue;
        if (at.node_of(a) == at.node_of(e))
          covariance(a, e) = inverse_of(layout_.nodes[at.node_of(a)])(p, q);
        else if (at.node_of(a) == at.node1)
          covariance(a, e) = inverse_below_[at.node1](p, q);
        else
          covariance(a, e) = inverse_below_[at.node1](q, p);
      }
    const double sigma = sigma_xy_of(problem_, state, k), w_xy = 1.0 / (sigma * sigma);
    if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k])
      by_global[layout_.sigma_s] -= 2.0 * link_trace(problem_, state, k, covariance, w_xy, ChainLink::Vector6::Zero());
    if (at.coordinate[2] < 0) continue;  // exact headings: the link is linear
    for (int a = 0; a < 6; ++a) {
      if (at.coordinate[a] < 0) continue;
      const double step = 1e-5;  // the trace is a smooth function of order one: error of order step^2
      ChainLink::Vector6 moved = ChainLink::Vector6::Zero();
      moved[a] = step;
      const double up = link_trace(problem_, state, k, covariance, w_xy, moved);
      moved[a] = -step;
      const double down = link_trace(problem_, state, k, covariance, w_xy, moved);
      by_stop[layout_.nodes[at.node_of(a)].coordinate + at.coordinate[a]] += (up - down) / (2.0 * step);
    }
  }
  return 0.5 * (by_global - couple(solve_stops(by_stop)));
}

Eigen::MatrixXd JointSystem::log_det_sigma_hessian(const JointState& state) const {
  selected_inverse();
  const Cells& c = problem_.cells;
  const int ns = layout_.sigma_count();
  Eigen::MatrixXd result = Eigen::MatrixXd::Zero(ns, ns);
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  // Which sigmas scale a share of H: the range's (laws of one parameter), the bearing's, the stops'.
  const int of_share[3] = {layout_.tau_count == 1 ? 0 : -1, layout_.sigma_theta - layout_.tau_begin,
                           layout_.sigma_s >= 0 ? ns - 1 : -1};
  std::vector<double> share, scaled;
  for (const JointLayout::Node& node : layout_.nodes) {
    const int dim = node.dim, square = dim * dim;
    if (dim == 0) continue;
    share.assign(3 * square, 0.0);
    scaled.resize(3 * square);
    for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
      const int k = node.stops[slot], heading = node.heading[slot];
      const Pose2& pose = state.stops[k];
      if (of_share[2] >= 0 && problem_.sigma_s_shared[k] && problem_.stops[k].opens_place) {
        share[2 * square] += 1.0 / (*state.sigma_s_m * *state.sigma_s_m);
        share[2 * square + dim + 1] += 1.0 / (*state.sigma_s_m * *state.sigma_s_m);
      }
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
        const Eigen::Vector2d& axis = state.landmarks[c.landmark[i]];
        const double vx = axis.x() - pose.x_m, vy = axis.y() - pose.y_m, D = std::sqrt(vx * vx + vy * vy);
        const double inverse = 1.0 / D, nx = vx * inverse, ny = vy * inverse;
        const double w = c.bearing_weight[i] * bearing_information;
        double* const bearing = share.data() + square;
        const double tx = -ny * inverse, ty = nx * inverse;
        if (node.free_position) {
          bearing[0] += w * tx * tx;
          bearing[1] += w * tx * ty;
          bearing[dim] += w * tx * ty;
          bearing[dim + 1] += w * ty * ty;
          if (of_share[0] >= 0) {
            const double information = expected_information(state, D - c.radius_m[i], c, i);
            share[0] += information * nx * nx;
            share[1] += information * nx * ny;
            share[dim] += information * nx * ny;
            share[dim + 1] += information * ny * ny;
          }
        }
        if (heading >= 0) {
          bearing[heading * dim + heading] += w;
          if (node.free_position) {
            bearing[heading * dim] += w * tx;
            bearing[heading * dim + 1] += w * ty;
            bearing[heading] += w * tx;
            bearing[dim + heading] += w * ty;
          }
        }
      }
    }
    const double* C = inverse_diagonal_.data() + node.square;
    for (int m = 0; m < 3; ++m)
      for (int column = 0; column < dim; ++column)
        for (int row = 0; row < dim; ++row) {
          double sum = 0.0;
          for (int e = 0; e < dim; ++e) sum += C[e * dim + row] * share[m * square + column * dim + e];
          scaled[m * square + column * dim + row] = sum;
        }
    for (int m = 0; m < 3; ++m) {
      if (of_share[m] < 0) continue;
      for (int row = 0; row < dim; ++row) result(of_share[m], of_share[m]) += 2.0 * scaled[m * square + row * dim + row];
      for (int o = 0; o < 3; ++o) {
        if (of_share[o] < 0) continue;
        double trace = 0.0;
        for (int column = 0; column < dim; ++column)
          for (int row = 0; row < dim; ++row)
            trace += scaled[m * square + column * dim + row] * scaled[o * square + row * dim + column];
        result(of_share[m], of_share[o]) -= 2.0 * trace;
      }
    }
  }
  return result;
}

}  // namespace rangecal
