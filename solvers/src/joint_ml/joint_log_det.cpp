// SPDX-License-Identifier: BSD-3-Clause
// What Laplace's method adds to the joint NLL, 1/2 log det H_ss: its gradient, and its second derivatives in the sigmas.
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "joint_ml/trace_gradient.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

/// C = H_ss^-1 as trace_gradient() reads it.
class StopCovariance {
 public:
  StopCovariance(const JointLayout& layout, const double* diagonal, const std::vector<std::size_t>& begin,
                 const std::vector<Eigen::MatrixXd>& below)
      : layout_(layout), diagonal_(diagonal), begin_(begin), below_(below) {}

  static constexpr bool with_alpha = false;
  void enter(const JointLayout::Node& node) {
    dim_ = node.dim;
    moves_ = node.free_position;
    block_ = diagonal_ + begin_[&node - layout_.nodes.data()];
  }
  double position_trace() const { return moves_ ? block_[0] + block_[dim_ + 1] : 0.0; }
  void cell(int heading, int, int, SightCovariance& c) const {
    c.xx = moves_ ? block_[0] : 0.0;
    c.xy = moves_ ? block_[1] : 0.0;
    c.yy = moves_ ? block_[dim_ + 1] : 0.0;
    c.xh = moves_ && heading >= 0 ? block_[heading * dim_] : 0.0;
    c.yh = moves_ && heading >= 0 ? block_[heading * dim_ + 1] : 0.0;
    c.hh = heading >= 0 ? block_[heading * dim_ + heading] : 0.0;
  }
  double between(int node_a, int p, int node_b, int q) const {
    if (node_a < node_b) return below_[node_b](q, p);
    if (node_a > node_b) return below_[node_a](p, q);
    return diagonal_[begin_[node_a] + static_cast<std::size_t>(q) * layout_.nodes[node_a].dim + p];
  }
  double landmarks(int, int) const { return 0.0; }

 private:
  const JointLayout& layout_;
  const double* diagonal_;
  const std::vector<std::size_t>& begin_;
  const std::vector<Eigen::MatrixXd>& below_;
  int dim_ = 0;
  bool moves_ = false;
  const double* block_ = nullptr;
};

/// Expected information of one cell's readings about d, for a law of one parameter.
double expected_information(const JointState& state, double d, const Cells& c, std::size_t i) {
  double f = 0.0, slope = 0.0;
  for (Eigen::Index a = state.alpha.size(); a-- > 0;) {
    slope = slope * d + f;
    f = f * d + state.alpha[a];
  }
  const double s = state.noise.spread(d, f);
  const Noise::LogSlopes log_s = state.noise.log_slopes(d, f);
  const double log_slope = log_s.by_f * slope + log_s.by_d;
  if (!c.effect_slope.empty()) slope += c.effect_slope[i];
  return c.range_weight[i] * slope * slope / (s * s) + 2.0 * c.count[i] * log_slope * log_slope;
}

}  // namespace

Eigen::VectorXd JointSystem::log_det_gradient(const JointState& state) const {
  selected_inverse();
  StopCovariance covariance(layout_, inverse_diagonal_.data(), inverse_begin_, inverse_below_);
  return trace_gradient(state, covariance);
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
    const double* C = inverse_of_node(node);
    for (int m = 0; m < 3; ++m)
      for (int column = 0; column < dim; ++column)
        for (int row = 0; row < dim; ++row) {
          double sum = 0.0;
          for (int e = 0; e < dim; ++e) sum += C[e * dim + row] * share[m * square + column * dim + e];
          scaled[m * square + column * dim + row] = sum;
        }
    for (int m = 0; m < 3; ++m) {
      if (of_share[m] < 0) continue;
      for (int row = 0; row < dim; ++row)
        result(of_share[m], of_share[m]) += 2.0 * scaled[m * square + row * dim + row];
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
