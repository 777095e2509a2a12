// SPDX-License-Identifier: BSD-3-Clause
// One pass over the cells: value, gradient and Hessian blocks of the joint NLL. Each cell depends on its place only
// through (d, bearing), so that the place's own blocks are sums of the landmark's with the sign turned.

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "in_parallel.hpp"
#include "joint_ml/blocks.hpp"
#include "joint_ml/joint_accumulator.hpp"
#include "joint_ml/range_share.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The prior of a stop with a covariance of its own; returns its share of the NLL.
double add_shaped_prior(const StopPrior& prior, const Pose2& pose, NodeBlocks<Eigen::Dynamic>& b,
                        int heading) {
  const StopInformation information(prior, prior.sigma_xy_m);
  const Eigen::Vector3d e(pose.x_m - prior.commanded.x_m, pose.y_m - prior.commanded.y_m,
                          wrap_angle(pose.heading_rad - prior.commanded.heading_rad));
  const Eigen::Vector3d pull = information.W * e;
  const int own[3] = {0, 1, heading};
  for (int i = 0; i < (heading >= 0 ? 3 : 2); ++i) {
    b.g[own[i]] += pull[i];
    for (int j = 0; j < (heading >= 0 ? 3 : 2); ++j) b.H(own[i], own[j]) += information.W(i, j);
  }
  return 0.5 * e.dot(pull) + information.log_scale;
}
}  // namespace

double JointSystem::assemble_priors(const JointState& state, bool exact, const JointLayout::Node& node,
                                    Accumulator& sum) {
  NodeBlocks<Eigen::Dynamic> b(node, arena_.data(), stop_gradient_.data());
  double nll = 0.0;
  for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
    const int k = node.stops[slot], heading = node.heading[slot];
    const Pose2& pose = state.stops[k];
    const StopPrior& prior = problem_.stops[k];
    if (prior.chained) continue;
    if (prior.shape && prior.opens_place) {
      nll += add_shaped_prior(prior, pose, b, heading);
      continue;
    }
    if (node.free_position && prior.opens_place) {
      const double sigma = sigma_xy_of(problem_, state, k), information = 1.0 / (sigma * sigma);
      const double ex = pose.x_m - prior.commanded.x_m, ey = pose.y_m - prior.commanded.y_m;
      const double chi_sq = (ex * ex + ey * ey) * information;
      nll += 0.5 * chi_sq + 2.0 * (std::log(sigma) + half_log_two_pi);
      b.g[0] += information * ex;
      b.g[1] += information * ey;
      b.H(0, 0) += information;
      b.H(1, 1) += information;
      if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k]) {
        sum.sigma_s_gradient += 2.0 - chi_sq;
        sum.sigma_s_hessian += exact ? 2.0 * chi_sq : 4.0;
        const int column = layout_.alpha_count + layout_.sigma_count() - 1;
        if (exact) {
          b.G(0, column) -= 2.0 * information * ex;
          b.G(1, column) -= 2.0 * information * ey;
        }
      }
    }
    if (heading >= 0) {
      const double turn = wrap_angle(pose.heading_rad - prior.commanded.heading_rad);
      const double information = 1.0 / (prior.sigma_heading_rad * prior.sigma_heading_rad);
      nll += 0.5 * turn * turn * information + std::log(prior.sigma_heading_rad) + half_log_two_pi;
      b.g[heading] += information * turn;
      b.H(heading, heading) += information;
    }
  }
  return nll;
}

template <int NA>
double JointSystem::assemble_node(const JointState& state, HessianKind kind, int index, Accumulator& sum) {
  const JointLayout::Node& node = layout_.nodes[index];
  const Cells& c = problem_.cells;
  const bool exact = kind == HessianKind::exact, moves = node.free_position;
  const int na = NA > 0 ? NA : layout_.alpha_count, m = NA > 0 ? NA + 1 : sum.m, dim = node.dim;
  double* const H = arena_.data() + node.block;
  double* const G = H + 2 * dim * dim;
  double* const g = stop_gradient_.data() + node.coordinate;
  std::fill(H, H + dim * dim, 0.0);
  std::fill(G, G + dim * node.columns, 0.0);
  std::fill(g, g + dim, 0.0);
  double nll = assemble_priors(state, exact, node, sum);

  const NoiseLaw law = state.noise.law;
  const bool power_law = is_power_of_f(law), has_slope = !c.effect_slope.empty();
  const double sigma = state.noise.parameters[0], tau = power_law ? std::log(sigma) : 0.0;
  if (power_law && !(sigma > 0.0)) return infinity;
  const PowerLaw power{state.noise.power_of_f(), 1.0 / (sigma * sigma)};
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  const double per_reading = std::log(state.sigma_theta_rad) + 2.0 * half_log_two_pi;
  const int first_landmark_column = na + layout_.sigma_count(), bearing_column = na + layout_.tau_count;
  RangeTerm<2> general;
  RangeShare share;
  double product = 1.0, log_sum = 0.0;
  double position[5] = {}, position_curve[2 * max_curve] = {}, position_bearing[2] = {};

  for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
    const int k = node.stops[slot], heading = node.heading[slot];
    const Pose2& pose = state.stops[k];
    const double ch = pose.heading_rad == 0.0 ? 1.0 : std::cos(pose.heading_rad);
    const double sh = pose.heading_rad == 0.0 ? 0.0 : std::sin(pose.heading_rad);
    for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
      const Eigen::Vector2d& axis = state.landmarks[c.landmark[i]];
      const double vx = axis.x() - pose.x_m, vy = axis.y() - pose.y_m;
      const double D = std::sqrt(vx * vx + vy * vy), inverse = 1.0 / D, nx = vx * inverse, ny = vy * inverse;
      const double d = D - c.radius_m[i];
      if (power_law) {
        const auto add_share = has_slope ? power_law_share<NA, true> : power_law_share<NA, false>;
        if (!add_share(power, state.alpha.data(), na, tau, d, c, static_cast<std::size_t>(i), exact, product,
                       share, sum.curve_gradient.data(), sum.curve_hessian.data()))
          return infinity;
        if (!(product > 1e-100 && product < 1e100)) {
          log_sum += std::log(std::abs(product));
          product = 1.0;
        }
      } else if (!general_share(general, state, d, c, i, exact, share, sum.curve_gradient.data(),
                                sum.curve_hessian.data())) {
        return infinity;
      }

      const double cb = bearing_direction_[2 * i], sb = bearing_direction_[2 * i + 1];
      const double turn = bearing_error(cb * ch - sb * sh, sb * ch + cb * sh, vx, vy);
      const double w = c.bearing_weight[i] * bearing_information, w_turn = w * turn;
      const double chi_sq = w_turn * turn + w * c.bearing_mean_square[i];
      nll += share.value + 0.5 * chi_sq + c.count[i] * per_reading;

      // Along n = (nx, ny) and across t = (-ny, nx).
      const double across = -w_turn * inverse;
      const double gx = share.along * nx - across * ny, gy = share.along * ny + across * nx;
      double nn = share.along_along, tt = w * inverse * inverse, nt = 0.0;
      if (exact) {
        tt += share.along * inverse;
        nt = w_turn * inverse * inverse;
      }
      const double hxx = nn * nx * nx + (tt * ny - 2.0 * nt * nx) * ny;
      const double hxy = (nn - tt) * nx * ny + nt * (nx * nx - ny * ny);
      const double hyy = nn * ny * ny + (tt * nx + 2.0 * nt * ny) * nx;

      double* const of = sum.landmark.data() + static_cast<std::size_t>(c.landmark[i]) * sum.stride;
      of[0] += gx;
      of[1] += gy;
      of[2] += hxx;
      of[3] += hxy;
      of[4] += hyy;
      for (int a = 0; a < m; ++a) {
        const double cx = share.cross[a] * nx, cy = share.cross[a] * ny;
        of[5 + 2 * a] += cx;
        of[6 + 2 * a] += cy;
        position_curve[2 * a] += cx;
        position_curve[2 * a + 1] += cy;
      }
      sum.bearing_gradient += c.count[i] - chi_sq;
      sum.bearing_hessian += exact ? 2.0 * chi_sq : 2.0 * c.count[i];
      if (exact) {
        const double cross = 2.0 * w_turn * inverse;
        of[5 + 2 * m] -= cross * ny;
        of[6 + 2 * m] += cross * nx;
        position_bearing[0] -= cross * ny;
        position_bearing[1] += cross * nx;
      }
      double* const column = G + dim * (first_landmark_column + 2 * layout_.slot_of(node, i));
      if (moves) {
        position[0] += gx;
        position[1] += gy;
        position[2] += hxx;
        position[3] += hxy;
        position[4] += hyy;
        column[0] -= hxx;
        column[1] -= hxy;
        column[dim] -= hxy;
        column[dim + 1] -= hyy;
      }
      if (heading >= 0) {
        const double tx = -w * inverse * ny, ty = w * inverse * nx;
        g[heading] += w_turn;
        H[heading * dim + heading] += w;
        if (moves) {
          H[heading * dim] += tx;
          H[heading * dim + 1] += ty;
          H[heading] += tx;
          H[dim + heading] += ty;
        }
        column[heading] -= tx;
        column[dim + heading] -= ty;
        if (exact) G[dim * bearing_column + heading] -= 2.0 * w_turn;
      }
    }
  }
  if (moves) {
    g[0] -= position[0];
    g[1] -= position[1];
    H[0] += position[2];
    H[1] += position[3];
    H[dim] += position[3];
    H[dim + 1] += position[4];
    for (int a = 0; a < m; ++a)
      for (int e = 0; e < 2; ++e)
        G[dim * a + e] -= position_curve[2 * a + e];  // tau follows alpha in the columns too
    G[dim * bearing_column] -= position_bearing[0];
    G[dim * bearing_column + 1] -= position_bearing[1];
  }
  if (power_law && power.power > 0) nll += power.power * (log_sum + std::log(std::abs(product)));
  return nll;
}

template <int NA>
void JointSystem::assemble_part(const JointState& state, HessianKind kind, std::size_t begin, std::size_t end,
                                Accumulator& sum) {
  for (std::size_t j = begin; j < end && std::isfinite(sum.nll); ++j)
    sum.nll += assemble_node<NA>(state, kind, static_cast<int>(j), sum);
}

namespace {

/// f<NA>: with the number of coefficients of alpha where that is known when compiled, else 0.
template <typename Function>
void with_alpha_count(const JointState& state, int alpha_count, const Function& f) {
  const int fixed = is_power_of_f(state.noise.law) ? alpha_count : 0;
  if (fixed == 2)
    f.template operator()<2>();
  else if (fixed == 3)
    f.template operator()<3>();
  else if (fixed == 4)
    f.template operator()<4>();
  else
    f.template operator()<0>();
}

}  // namespace

double JointSystem::assemble(const JointState& state, HessianKind kind) {
  inverse_valid_ = false;
  const std::size_t nodes = layout_.nodes.size();
  const int parts = part_count(nodes);
  if (sums_.empty()) sums_.assign(parts, Accumulator(layout_, problem_.landmark_count()));
  if (!(state.sigma_theta_rad > 0.0)) return infinity;
  with_alpha_count(state, layout_.alpha_count, [&]<int NA>() {
    in_parallel(parts, [&](int part) {
      sums_[part].clear();
      assemble_part<NA>(state, kind, nodes * part / parts, nodes * (part + 1) / parts, sums_[part]);
    });
  });
  for (int part = 1; part < parts; ++part) sums_[0].add(sums_[part]);
  collect(sums_);
  nll_ = sums_[0].nll - silent_bearing_nll(problem_);
  if (layout_.chained) nll_ += assemble_chain_links(state, kind);
  nll_ += assemble_taped(state, kind);
  return std::isnan(nll_) ? infinity : nll_;
}

template <int NA>
bool JointSystem::settle_node(JointState& state, int index, Accumulator& unused) {
  constexpr int most = 100;
  constexpr double settled = 1e-12, least_damping = 1e-4, most_damping = 1e8;
  const JointLayout::Node& node = layout_.nodes[index];
  if (node.dim == 0) return true;
  NodeBlocks<Eigen::Dynamic> b(node, arena_.data(), stop_gradient_.data());
  HessianKind kind = HessianKind::exact;
  double nll = assemble_node<NA>(state, kind, index, unused), damping = 0.0, log_det = 0.0;
  Eigen::VectorXd step(node.dim);
  for (int iteration = 0; iteration < most && std::isfinite(nll) && damping < most_damping; ++iteration) {
    if (!factor_node(b, damping, log_det)) {
      if (kind == HessianKind::fisher) damping = std::max(10.0 * damping, least_damping);
      kind = HessianKind::fisher;
      nll = assemble_node<NA>(state, kind, index, unused);
      continue;
    }
    step = -b.g;
    solve_factored(b.L.data(), node.dim, step.data());
    const double decrement_sq = -b.g.dot(step);
    if (decrement_sq < settled && kind == HessianKind::exact && damping == 0.0) return true;
    move_node(node, step, state);
    const HessianKind next_kind = decrement_sq < 1.0 + 0.1 * node.dim ? HessianKind::exact : kind;
    const double there = assemble_node<NA>(state, next_kind, index, unused);
    if (there <= nll + 1e-12 * (1.0 + std::abs(nll))) {
      nll = there;
      kind = next_kind;
      damping = damping > least_damping ? 0.1 * damping : 0.0;
    } else {
      move_node(node, -step, state);
      damping = std::max(10.0 * damping, least_damping);
      kind = HessianKind::fisher;
      nll = assemble_node<NA>(state, kind, index, unused);
    }
  }
  return false;
}

bool JointSystem::settle_nodes(JointState& state) {
  const std::size_t nodes = layout_.nodes.size();
  const int parts = part_count(nodes);
  if (sums_.empty()) sums_.assign(parts, Accumulator(layout_, problem_.landmark_count()));
  JointState settled = state;
  std::vector<char> good(static_cast<std::size_t>(parts), 1);
  with_alpha_count(state, layout_.alpha_count, [&]<int NA>() {
    in_parallel(parts, [&](int part) {
      for (std::size_t j = nodes * part / parts; j < nodes * (part + 1) / parts && good[part]; ++j)
        good[part] = settle_node<NA>(settled, static_cast<int>(j), sums_[part]);
    });
  });
  if (std::find(good.begin(), good.end(), 0) != good.end()) return false;
  state = std::move(settled);
  return true;
}

}  // namespace rangecal
