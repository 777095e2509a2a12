// SPDX-License-Identifier: BSD-3-Clause
// The gradient of 1/2 log det H_ss, which Laplace's method adds to the joint NLL. With C = H_ss^-1 held,
// d(1/2 log det H) = 1/2 tr(C dH), a sum over cells and links; the stops follow by the implicit function theorem.
#include <Eigen/Cholesky>
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "joint_ml/chain_link.hpp"
#include "rangecal/core/angles.hpp"
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

}  // namespace

Eigen::VectorXd JointSystem::log_det_gradient(const JointState& state) const {
  selected_inverse();
  const Cells& c = problem_.cells;
  const int na = layout_.alpha_count, nt = layout_.tau_count;
  Eigen::VectorXd by_global = Eigen::VectorXd::Zero(layout_.global_count);
  Eigen::VectorXd by_stop = Eigen::VectorXd::Zero(layout_.coordinates);
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  RangeTerm<3> term;

  for (std::size_t j = 0; j < layout_.nodes.size(); ++j) {
    const JointLayout::Node& node = layout_.nodes[j];
    const Eigen::Map<const Eigen::MatrixXd> covariance = inverse_of(node);
    auto own = by_stop.segment(node.coordinate, node.dim);
    for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
      const int k = node.stops[slot], heading = node.heading[slot];
      Eigen::Matrix2d position = Eigen::Matrix2d::Zero();
      if (node.free_position) position = covariance.topLeftCorner<2, 2>();
      Eigen::Vector2d with_heading = Eigen::Vector2d::Zero();
      if (node.free_position && heading >= 0) with_heading = covariance.block<2, 1>(0, heading);
      const double turn_variance = heading >= 0 ? covariance(heading, heading) : 0.0;
      if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k] && problem_.stops[k].opens_place &&
          !problem_.stops[k].chained) {
        const double sigma = *state.sigma_s_m;
        by_global[layout_.sigma_s] -= 2.0 * position.trace() / (sigma * sigma);
      }
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
        const Sight sight(state.landmarks[c.landmark[i]], state.stops[k], c.radius_m[i]);
        term.evaluate(sight.d, c.count[i], c.range_weight[i], c.range_mean[i], c.range_mean_square[i], state.alpha,
                      state.noise);
        const double inverse = 1.0 / sight.axis_distance, inverse_sq = inverse * inverse;
        const Eigen::Vector2d &n = sight.n, &t = sight.t;
        const double nn = n.dot(position * n), tt = t.dot(position * t), nt_ = n.dot(position * t);
        const double n_h = n.dot(with_heading), t_h = t.dot(with_heading);
        // Range: trace = q'' nn + q'/D tt; n turns by 1/D per metre across.
        const double q1 = term.cost.first(), q2 = term.cost.second(), q3 = term.cost.third();
        double along = q3 * nn + (q2 - q1 * inverse) * inverse * tt;
        double across = 2.0 * (q2 - q1 * inverse) * inverse * nt_;
        // Bearing: trace = w tt/D^2 + 2 w r nt/D^2 + w hh + 2 w t_h/D, r the bearing error.
        const double w = c.bearing_weight[i] * bearing_information;
        const double r = wrap_angle(c.bearing_mean[i] - sight.bearing);
        const double bearing_trace =
            w * (inverse_sq * (tt + 2.0 * r * nt_) + turn_variance + 2.0 * inverse * t_h);
        along += -2.0 * w * inverse * inverse_sq * (tt + 2.0 * r * nt_) - 2.0 * w * inverse_sq * t_h;
        // across: dn = t/D, dt = -n/D, dr = -1/D
        across += w * inverse * inverse_sq * (-2.0 * nt_ - 2.0 * nt_ + 2.0 * r * (tt - nn)) -
                  2.0 * w * inverse_sq * n_h;
        const Eigen::Vector2d slope = along * n + across * t;
        by_global.segment<2>(layout_.landmark_begin + 2 * c.landmark[i]) += slope;
        if (node.free_position) own.head<2>() -= slope;
        if (heading >= 0) own[heading] += 2.0 * w * inverse_sq * nt_;  // dr/dh = 1
        by_global[layout_.sigma_theta] -= 2.0 * bearing_trace;
        for (int a = 0; a < na; ++a) {
          const Taylor<3> by_alpha = term.by_alpha(a);
          by_global[a] += by_alpha.second() * nn + by_alpha.first() * inverse * tt;
        }
        for (int e = 0; e < nt; ++e) {
          const Taylor<3> by_tau = term.by_tau(e);
          by_global[layout_.tau_begin + e] += by_tau.second() * nn + by_tau.first() * inverse * tt;
        }
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
  const int range_index = layout_.tau_count == 1 ? 0 : -1;
  RangeTerm<2> term;
  std::vector<Eigen::MatrixXd> share(ns);
  for (std::size_t j = 0; j < layout_.nodes.size(); ++j) {
    const JointLayout::Node& node = layout_.nodes[j];
    if (node.dim == 0) continue;
    for (Eigen::MatrixXd& matrix : share) matrix.setZero(node.dim, node.dim);
    Eigen::MatrixXd& bearing = share[layout_.sigma_theta - layout_.tau_begin];
    for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
      const int k = node.stops[slot], heading = node.heading[slot];
      if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k] && problem_.stops[k].opens_place)
        share[ns - 1].topLeftCorner<2, 2>() += Eigen::Matrix2d::Identity() / (*state.sigma_s_m * *state.sigma_s_m);
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
        const Sight sight(state.landmarks[c.landmark[i]], state.stops[k], c.radius_m[i]);
        Eigen::VectorXd range_row = Eigen::VectorXd::Zero(node.dim), bearing_row = range_row;
        if (node.free_position) {
          range_row.head<2>() = sight.n;
          bearing_row.head<2>() = sight.t / sight.axis_distance;
        }
        if (heading >= 0) bearing_row[heading] = 1.0;
        bearing += c.bearing_weight[i] * bearing_information * bearing_row * bearing_row.transpose();
        if (range_index >= 0 &&
            term.evaluate(sight.d, c.count[i], c.range_weight[i], c.range_mean[i], c.range_mean_square[i], state.alpha,
                          state.noise))
          share[0] += term.fisher_d_d * range_row * range_row.transpose();
      }
    }
    for (Eigen::MatrixXd& matrix : share) matrix = inverse_of(node) * matrix;
    for (int a = 0; a < ns; ++a) {
      result(a, a) += 2.0 * share[a].trace();
      for (int e = 0; e < ns; ++e) result(a, e) -= 2.0 * (share[a] * share[e]).trace();
    }
  }
  return result;
}

}  // namespace rangecal
