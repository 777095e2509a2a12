// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/joint_ml/joint_system.hpp"

#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <numbers>

#include "joint_ml/blocks.hpp"
#include "joint_ml/joint_accumulator.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
const double log_two_pi = std::log(2.0 * std::numbers::pi);

/// Nodes are cut into this many parts, whatever the number of threads, so that sums keep their bits.
int part_count(std::size_t nodes) { return nodes < 1024 ? 1 : 16; }

template <typename Body>
void for_parts(std::size_t nodes, const Body& body) {
  const int parts = part_count(nodes);
  const auto run = [&](int part) { body(part, nodes * part / parts, nodes * (part + 1) / parts); };
  if (parts == 1)
    run(0);
  else
    tbb::parallel_for(0, parts, run);
}

}  // namespace

JointSystem::JointSystem(const JointProblem& problem, int alpha_count, int tau_count, bool sigma_s_free)
    : problem_(problem), layout_(problem, alpha_count, tau_count, sigma_s_free) {
  const int p = layout_.global_count;
  gradient_.resize(p);
  hessian_.resize(p, p);
  schur_.resize(p, p);
  reduced_gradient_.resize(p);
  stop_gradient_.resize(layout_.coordinates);
  arena_.resize(layout_.arena);
  if (layout_.chained) {
    link_.resize(layout_.nodes.size());
    chain_coupling_.resize(layout_.nodes.size());
    chain_gradient_.resize(layout_.nodes.size());
  }
}

template <int D>
double JointSystem::assemble_node(const JointState& state, HessianKind kind, int index, Accumulator& sum) {
  const JointLayout::Node& node = layout_.nodes[index];
  const Cells& c = problem_.cells;
  const bool exact = kind == HessianKind::exact;
  const int na = layout_.alpha_count, nt = layout_.tau_count, ns = layout_.sigma_count();
  const int tau0 = layout_.tau_begin, eta = layout_.sigma_theta;
  NodeBlocks<D> b(node, arena_.data(), stop_gradient_.data());
  b.H.setZero();
  b.G.setZero();
  b.g.setZero();
  const double bearing_information = 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  const double log_sigma_theta = std::log(state.sigma_theta_rad);
  double nll = 0.0;
  RangeTerm<2> term;

  for (std::size_t slot = 0; slot < node.stops.size(); ++slot) {
    const int k = node.stops[slot], heading = node.heading[slot];
    const Pose2& pose = state.stops[k];
    const StopPrior& prior = problem_.stops[k];
    if (!prior.chained) {
      if (node.free_position && prior.opens_place) {
        const double sigma = sigma_xy_of(problem_, state, k), information = 1.0 / (sigma * sigma);
        const Eigen::Vector2d error(pose.x_m - prior.commanded.x_m, pose.y_m - prior.commanded.y_m);
        const double chi_sq = error.squaredNorm() * information;
        nll += 0.5 * chi_sq + 2.0 * std::log(sigma) + log_two_pi;
        b.g.template head<2>() += information * error;
        b.H(0, 0) += information;
        b.H(1, 1) += information;
        if (layout_.sigma_s >= 0 && problem_.sigma_s_shared[k]) {
          sum.gradient[layout_.sigma_s] += 2.0 - chi_sq;
          sum.hessian(layout_.sigma_s, layout_.sigma_s) += exact ? 2.0 * chi_sq : 4.0;
          if (exact) b.G.template block<2, 1>(0, na + ns - 1) -= 2.0 * information * error;
        }
      }
      if (heading >= 0) {
        const double turn = wrap_angle(pose.heading_rad - prior.commanded.heading_rad);
        const double information = 1.0 / (prior.sigma_heading_rad * prior.sigma_heading_rad);
        nll += 0.5 * turn * turn * information + std::log(prior.sigma_heading_rad) + 0.5 * log_two_pi;
        b.g[heading] += information * turn;
        b.H(heading, heading) += information;
      }
    }

    for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
      const Sight sight(state.landmarks[c.landmark[i]], pose, c.radius_m[i]);
      if (!term.evaluate(sight.d, c.count[i], c.range_weight[i], c.range_mean[i], c.range_mean_square[i], state.alpha,
                         state.noise))
        return infinity;
      const double turn = wrap_angle(c.bearing_mean[i] - sight.bearing);
      const double w = c.bearing_weight[i] * bearing_information;
      const double chi_sq = w * (turn * turn + c.bearing_mean_square[i]);
      nll += term.cost.value() + 0.5 * chi_sq + c.count[i] * (log_sigma_theta + log_two_pi);

      const double q1 = term.cost.first(), inverse = 1.0 / sight.axis_distance;
      const Eigen::Vector2d &n = sight.n, &t = sight.t;
      const Eigen::Vector2d gradient = q1 * n - (w * turn * inverse) * t;
      Eigen::Matrix2d hessian = (w * inverse * inverse) * (t * t.transpose());
      if (exact) {
        hessian += term.cost.second() * (n * n.transpose()) + (q1 * inverse) * (t * t.transpose());
        const Eigen::Matrix2d mixed = (w * turn * inverse * inverse) * (n * t.transpose());
        hessian += mixed + mixed.transpose();
      } else {
        hessian += term.fisher_d_d * (n * n.transpose());
      }

      const int landmark = layout_.landmark_begin + 2 * c.landmark[i];
      const int column = na + ns + 2 * layout_.slot_of_cell[i];
      sum.gradient.segment<2>(landmark) += gradient;
      sum.hessian.block<2, 2>(landmark, landmark) += hessian;
      if (node.free_position) {
        b.g.template head<2>() -= gradient;
        b.H.template topLeftCorner<2, 2>() += hessian;
        b.G.template block<2, 2>(0, column) -= hessian;
      }
      const Eigen::Vector2d turn_slope = (w * inverse) * t;
      if (heading >= 0) {
        b.g[heading] += w * turn;
        b.H(heading, heading) += w;
        if (node.free_position) {
          b.H.template block<2, 1>(0, heading) += turn_slope;
          b.H.template block<1, 2>(heading, 0) += turn_slope.transpose();
        }
        b.G.template block<1, 2>(heading, column) -= turn_slope.transpose();
        if (exact) b.G(heading, na + nt) -= 2.0 * w * turn;
      }
      sum.gradient[eta] += c.count[i] - chi_sq;
      sum.hessian(eta, eta) += exact ? 2.0 * chi_sq : 2.0 * c.count[i];
      if (exact) {
        const Eigen::Vector2d cross = (2.0 * w * turn * inverse) * t;
        sum.hessian.block<2, 1>(landmark, eta) += cross;
        if (node.free_position) b.G.template block<2, 1>(0, na + nt) -= cross;
      }

      const double aa = exact ? term.alpha_alpha : term.fisher_alpha_alpha;
      const double at = exact ? term.alpha_tau : term.fisher_alpha_tau;
      const double tt = exact ? term.tau_tau : term.fisher_tau_tau;
      for (int a = 0; a < na; ++a) {
        const Taylor<2> by_alpha = term.by_alpha(a);
        const double power = term.power[a].value();
        sum.gradient[a] += by_alpha.value();
        for (int e = a; e < na; ++e) sum.hessian(a, e) += aa * power * term.power[e].value();
        for (int j = 0; j < nt; ++j) sum.hessian(a, tau0 + j) += at * power * term.tau_slope(j);
        const Eigen::Vector2d cross = (exact ? by_alpha.first() : term.fisher_d_alpha * power) * n;
        sum.hessian.block<1, 2>(a, landmark) += cross.transpose();
        if (node.free_position) b.G.template block<2, 1>(0, a) -= cross;
      }
      for (int j = 0; j < nt; ++j) {
        const Taylor<2> by_tau = term.by_tau(j);
        sum.gradient[tau0 + j] += by_tau.value();
        for (int e = j; e < nt; ++e) sum.hessian(tau0 + j, tau0 + e) += tt * term.tau_slope(j) * term.tau_slope(e);
        const Eigen::Vector2d cross = (exact ? by_tau.first() : term.fisher_d_tau * term.tau_slope(j)) * n;
        sum.hessian.block<2, 1>(landmark, tau0 + j) += cross;
        if (node.free_position) b.G.template block<2, 1>(0, na + j) -= cross;
      }
    }
  }
  return nll;
}

double JointSystem::assemble_taped(const JointState& state, HessianKind kind) {
  double nll = 0.0;
  for (const KnownDistance& taped : problem_.known_distances) {
    const Eigen::Vector2d v = state.landmarks[taped.to] - state.landmarks[taped.from];
    const double length = v.norm(), error = length - taped.distance_m;
    const double information = 1.0 / (taped.sigma_m * taped.sigma_m);
    const Eigen::Vector2d n = v / length;
    nll += 0.5 * error * error * information + std::log(taped.sigma_m) + 0.5 * log_two_pi;
    Eigen::Matrix2d h = information * n * n.transpose();
    if (kind == HessianKind::exact)
      h += (information * error / length) * (Eigen::Matrix2d::Identity() - n * n.transpose());
    const int a = layout_.landmark_begin + 2 * taped.from, b = layout_.landmark_begin + 2 * taped.to;
    gradient_.segment<2>(a) -= information * error * n;
    gradient_.segment<2>(b) += information * error * n;
    hessian_.block<2, 2>(a, a) += h;
    hessian_.block<2, 2>(b, b) += h;
    hessian_.block<2, 2>(std::min(a, b), std::max(a, b)) -= h;
  }
  return nll;
}

double JointSystem::assemble(const JointState& state, HessianKind kind) {
  inverse_valid_ = false;
  const std::size_t nodes = layout_.nodes.size();
  std::vector<Accumulator> parts(part_count(nodes), Accumulator(layout_.global_count));
  for_parts(nodes, [&](int part, std::size_t begin, std::size_t end) {
    Accumulator& sum = parts[part];
    for (std::size_t j = begin; j < end && std::isfinite(sum.nll); ++j) {
      const int index = static_cast<int>(j);
      const int dim = layout_.nodes[j].dim;
      sum.nll += dim == 2   ? assemble_node<2>(state, kind, index, sum)
                 : dim == 3 ? assemble_node<3>(state, kind, index, sum)
                            : assemble_node<Eigen::Dynamic>(state, kind, index, sum);
    }
  });
  Accumulator& total = parts[0];
  for (std::size_t part = 1; part < parts.size(); ++part) {
    total.nll += parts[part].nll;
    total.gradient += parts[part].gradient;
    total.hessian += parts[part].hessian;
  }
  if (layout_.chained) total.nll += assemble_chain_links(state, kind, total);
  gradient_.swap(total.gradient);
  hessian_.swap(total.hessian);
  nll_ = total.nll + assemble_taped(state, kind);
  return std::isnan(nll_) ? infinity : nll_;
}

template <int D>
bool JointSystem::eliminate_node(int index, double damping, Eigen::MatrixXd& schur, Eigen::VectorXd& reduced,
                                 double& log_det) {
  const JointLayout::Node& node = layout_.nodes[index];
  NodeBlocks<D> b(node, arena_.data(), stop_gradient_.data());
  if (!factor_node(b, damping, log_det)) return false;
  constexpr int max_columns = 64;
  Eigen::Matrix<double, D, Eigen::Dynamic, 0, D, D == Eigen::Dynamic ? Eigen::Dynamic : max_columns> half;
  Eigen::Matrix<double, D, Eigen::Dynamic> half_large;
  const auto lower = b.L.template triangularView<Eigen::Lower>();
  const Eigen::Matrix<double, D, 1> half_gradient = lower.solve(b.g);
  const auto add = [&](const auto& w) {
    for (int e = 0; e < node.columns; ++e) {
      const int column = b.global_of(e, layout_);
      reduced[column] -= w.col(e).dot(half_gradient);
      for (int a = 0; a <= e; ++a) {
        const int row = b.global_of(a, layout_);
        schur(std::min(row, column), std::max(row, column)) -= w.col(a).dot(w.col(e));
      }
    }
  };
  if (node.columns <= max_columns) {
    half = lower.solve(b.G);
    add(half);
  } else {
    half_large = lower.solve(b.G);
    add(half_large);
  }
  return true;
}

bool JointSystem::eliminate(double damping) {
  inverse_valid_ = false;
  if (layout_.chained) return eliminate_chain(damping);
  const std::size_t nodes = layout_.nodes.size();
  const int parts = part_count(nodes), p = layout_.global_count;
  std::vector<Eigen::MatrixXd> schur(parts, Eigen::MatrixXd::Zero(p, p));
  std::vector<Eigen::VectorXd> reduced(parts, Eigen::VectorXd::Zero(p));
  std::vector<double> log_det(parts, 0.0);
  std::vector<char> ok(parts, 1);
  for_parts(nodes, [&](int part, std::size_t begin, std::size_t end) {
    for (std::size_t j = begin; j < end && ok[part]; ++j) {
      const int index = static_cast<int>(j);
      const int dim = layout_.nodes[j].dim;
      if (dim == 0) continue;
      ok[part] = dim == 2   ? eliminate_node<2>(index, damping, schur[part], reduced[part], log_det[part])
                 : dim == 3 ? eliminate_node<3>(index, damping, schur[part], reduced[part], log_det[part])
                            : eliminate_node<Eigen::Dynamic>(index, damping, schur[part], reduced[part], log_det[part]);
    }
  });
  for (char good : ok)
    if (!good) return false;
  log_det_stops_ = log_det[0];
  for (int part = 1; part < parts; ++part) {
    schur[0] += schur[part];
    reduced[0] += reduced[part];
    log_det_stops_ += log_det[part];
  }
  schur[0].diagonal() += (1.0 + damping) * hessian_.diagonal();
  schur[0].triangularView<Eigen::StrictlyUpper>() += hessian_;
  schur_ = schur[0].selfadjointView<Eigen::Upper>();
  reduced_gradient_ = gradient_ + reduced[0];
  return true;
}

Eigen::VectorXd JointSystem::couple(const Eigen::VectorXd& u) const {
  Eigen::VectorXd result = Eigen::VectorXd::Zero(layout_.global_count);
  for (const JointLayout::Node& node : layout_.nodes) {
    const NodeView b(node, arena_.data());
    for (int e = 0; e < node.columns; ++e)
      result[b.global_of(e, layout_)] += b.G.col(e).dot(u.segment(node.coordinate, node.dim));
  }
  return result;
}

Eigen::VectorXd JointSystem::back_substitute(const Eigen::VectorXd& globals, bool with_gradient) const {
  Eigen::VectorXd rhs(layout_.coordinates);
  for (const JointLayout::Node& node : layout_.nodes) {
    const NodeView b(node, arena_.data());
    auto segment = rhs.segment(node.coordinate, node.dim);
    if (with_gradient)
      segment = -stop_gradient_.segment(node.coordinate, node.dim);
    else
      segment.setZero();
    for (int e = 0; e < node.columns; ++e) segment -= b.G.col(e) * globals[b.global_of(e, layout_)];
  }
  return solve_stops(rhs);
}

void JointSystem::clear() {
  inverse_valid_ = false;
  std::fill(arena_.begin(), arena_.end(), 0.0);
  gradient_.setZero();
  hessian_.setZero();
  stop_gradient_.setZero();
  for (Eigen::MatrixXd& link : link_) link.setZero(0, 0);
}

void JointSystem::accumulate(const JointSystem& other, double weight) {
  inverse_valid_ = false;
  for (std::size_t i = 0; i < arena_.size(); ++i) arena_[i] += weight * other.arena_[i];
  gradient_ += weight * other.gradient_;
  hessian_ += weight * other.hessian_;
  stop_gradient_ += weight * other.stop_gradient_;
  for (std::size_t j = 0; j < link_.size(); ++j) {
    if (other.link_[j].size() == 0) continue;
    if (link_[j].size() == 0) link_[j].setZero(other.link_[j].rows(), other.link_[j].cols());
    link_[j] += weight * other.link_[j];
  }
}

}  // namespace rangecal
