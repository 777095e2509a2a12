// SPDX-License-Identifier: BSD-3-Clause
// Elimination of independent stops from the assembled blocks, and what follows from it.
#include "rangecal/solvers/joint_ml/joint_system.hpp"

#include <algorithm>
#include <cmath>

#include "in_parallel.hpp"
#include "joint_ml/blocks.hpp"
#include "joint_ml/joint_accumulator.hpp"

namespace rangecal {

JointSystem::JointSystem(const JointProblem& problem, int alpha_count, int tau_count, bool sigma_s_free)
    : problem_(problem), layout_(problem, alpha_count, tau_count, sigma_s_free) {
  const int p = layout_.global_count;
  gradient_.resize(p);
  hessian_.resize(p, p);
  schur_.resize(p, p);
  reduced_gradient_.resize(p);
  stop_gradient_.resize(layout_.coordinates);
  arena_.resize(layout_.arena);
  const std::vector<double>& bearing = problem.cells.bearing_mean;
  bearing_direction_.resize(2 * bearing.size());
  for (std::size_t i = 0; i < bearing.size(); ++i) {
    bearing_direction_[2 * i] = std::cos(bearing[i]);
    bearing_direction_[2 * i + 1] = std::sin(bearing[i]);
  }
  if (layout_.chained) {
    link_.resize(layout_.nodes.size());
    link_half_.resize(layout_.nodes.size());
  }
}

JointSystem::~JointSystem() = default;
JointSystem::JointSystem(JointSystem&&) noexcept = default;

/// Adds to rows e and e + 1 of an upper triangle, both from column e on, what the rows w0, w1 of a factor give.
inline void add_outer_rows(const double* __restrict w0, const double* __restrict w1, int e, int stride,
                           double* __restrict to) {
  double* const below = to + stride;
  const double x0 = w0[e], y0 = w1[e], x1 = w0[e + 1], y1 = w1[e + 1];
  for (int f = e; f < stride; f += 2) {
    const double a = to[f] + x0 * w0[f] + y0 * w1[f], b = to[f + 1] + x0 * w0[f + 1] + y0 * w1[f + 1];
    const double c = below[f] + x1 * w0[f] + y1 * w1[f], d = below[f + 1] + x1 * w0[f + 1] + y1 * w1[f + 1];
    to[f] = a;
    to[f + 1] = b;
    below[f] = c;
    below[f + 1] = d;
  }
}

template <int D>
bool JointSystem::eliminate_node(const JointLayout::Node& node, double damping, Elimination& sum) {
  NodeBlocks<D> b(node, arena_.data(), stop_gradient_.data());
  if (!factor_node(b, damping, sum.log_det)) return false;
  const int dim = D == Eigen::Dynamic ? node.dim : D, columns = node.columns;
  const double *L = b.L.data(), *G = b.G.data(), *g = b.g.data();
  if (!std::equal(sum.landmarks.begin(), sum.landmarks.end(), node.landmarks.begin(), node.landmarks.end()))
    flush(sum, node.landmarks);
  const std::size_t stride = sum.stride;  // of rows of (L^-1 G, L^-1 g)
  double* const W = sum.half.data();
  for (int i = 0; i < dim; ++i) {
    const double inverse = 1.0 / L[i * dim + i];
    double* const row = W + i * stride;
    for (int e = 0; e < columns; ++e) row[e] = G[e * dim + i];
    row[columns] = g[i];
    for (int k = 0; k < i; ++k) {
      const double factor = L[k * dim + i];
      const double* above = W + k * stride;
      for (int e = 0; e <= columns; ++e) row[e] -= factor * above[e];
    }
    for (int e = 0; e <= columns; ++e) row[e] *= inverse;
    if (columns % 2 == 0) row[columns + 1] = 0.0;
  }

  // W^T W over the node's own columns, the gradient as the last of them: neighbours mostly see the same landmarks.
  double* const own = sum.own.data();
  for (int i = 0; i < dim; i += 2) {
    const double* const w0 = W + i * stride;
    const double* const w1 = i + 1 < dim ? w0 + stride : sum.zeros.data();
    for (int e = 0; e < columns; e += 2)
      add_outer_rows(w0, w1, e, static_cast<int>(stride), own + e * stride);
  }
  return true;
}

/// Takes what has gathered over the present columns from the Schur complement, and begins anew over `next`.
void JointSystem::flush(Elimination& sum, std::span<const int> next) const {
  const int na = layout_.alpha_count, before = na + layout_.sigma_count();
  const auto global_of = [&](int column) {
    return column < na ? column
           : column < before
               ? layout_.phi_count + column - na
               : layout_.landmark_begin + 2 * sum.landmarks[(column - before) / 2] + (column - before) % 2;
  };
  for (int e = 0; e < sum.columns; ++e) {
    const int from = global_of(e);
    const double* const row = sum.own.data() + e * sum.stride;
    for (int f = e; f < sum.columns; ++f) {
      const int to = global_of(f);
      sum.schur(std::min(from, to), std::max(from, to)) -= row[f];
    }
    sum.reduced[from] -= row[sum.columns];
  }
  sum.landmarks.assign(next.begin(), next.end());
  sum.columns = before + 2 * static_cast<int>(next.size());
  sum.stride = (sum.columns + 2) & ~1;
  std::fill_n(sum.own.begin(), sum.stride * sum.stride, 0.0);
}

bool JointSystem::eliminate(double damping) {
  inverse_valid_ = false;
  if (layout_.chained) {
    if (!factor_chain(damping)) return false;
    eliminate_chain(damping);
    return true;
  }
  const std::size_t nodes = layout_.nodes.size();
  const int parts = part_count(nodes), p = layout_.global_count;
  if (eliminations_.empty()) {
    std::size_t dims = 0, columns = 0;
    for (const JointLayout::Node& node : layout_.nodes) {
      dims = std::max(dims, static_cast<std::size_t>(node.dim));
      columns = std::max(columns, static_cast<std::size_t>(node.columns));
    }
    eliminations_.resize(parts);
    for (Elimination& part : eliminations_) {
      part.half.resize(dims * (columns + 2));
      part.zeros.assign(columns + 2, 0.0);
      part.own.resize((columns + 2) * (columns + 2));
    }
  }
  const auto run = [&](int part) {
    Elimination& sum = eliminations_[part];
    sum.schur.setZero(p, p);
    sum.reduced.setZero(p);
    sum.log_det = 0.0;
    sum.ok = true;
    sum.columns = 0;
    flush(sum, {});
    const std::size_t end = nodes * (part + 1) / parts;
    for (std::size_t j = nodes * part / parts; j < end && sum.ok; ++j) {
      const JointLayout::Node& node = layout_.nodes[j];
      if (node.dim == 0) continue;
      sum.ok = with_dimension(node.dim, [&]<int D>() { return eliminate_node<D>(node, damping, sum); });
    }
    flush(sum, {});
  };
  in_parallel(parts, run);
  for (const Elimination& part : eliminations_)
    if (!part.ok) return false;
  Elimination& total = eliminations_[0];
  for (int part = 1; part < parts; ++part) {
    total.schur += eliminations_[part].schur;
    total.reduced += eliminations_[part].reduced;
    total.log_det += eliminations_[part].log_det;
  }
  log_det_stops_ = total.log_det;
  for (int column = 0; column < p; ++column) {
    for (int row = 0; row < column; ++row) {
      const double value = total.schur(row, column) + hessian_(row, column);
      schur_(row, column) = value;
      schur_(column, row) = value;
    }
    schur_(column, column) = total.schur(column, column) + (1.0 + damping) * hessian_(column, column);
  }
  reduced_gradient_ = gradient_ + total.reduced;
  return true;
}

bool JointSystem::factor_stops(double damping) {
  inverse_valid_ = false;
  if (layout_.chained) return factor_chain(damping);
  const std::size_t nodes = layout_.nodes.size();
  const int parts = part_count(nodes);
  std::vector<char> good(static_cast<std::size_t>(parts), 1);
  in_parallel(parts, [&](int part) {
    double unused = 0.0;
    const std::size_t end = nodes * (part + 1) / parts;
    for (std::size_t j = nodes * part / parts; j < end && good[part]; ++j) {
      const JointLayout::Node& node = layout_.nodes[j];
      const auto factored = [&]<int D>() {
        NodeBlocks<D> b(node, arena_.data(), stop_gradient_.data());
        return factor_node(b, damping, unused);
      };
      good[part] = with_dimension(node.dim, factored);
    }
  });
  return std::find(good.begin(), good.end(), 0) == good.end();
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
  const int na = layout_.alpha_count, ns = layout_.sigma_count();
  for (const JointLayout::Node& node : layout_.nodes) {
    const int dim = node.dim;
    const double* column = arena_.data() + node.block + 2 * dim * dim;
    double* const own = rhs.data() + node.coordinate;
    const double* const g = stop_gradient_.data() + node.coordinate;
    for (int i = 0; i < dim; ++i) own[i] = with_gradient ? -g[i] : 0.0;
    const auto take = [&](const double* by, int count) {
      if (dim == 2) {
        double x = own[0], y = own[1];
        for (int e = 0; e < count; ++e, column += 2) {
          x -= column[0] * by[e];
          y -= column[1] * by[e];
        }
        own[0] = x;
        own[1] = y;
        return;
      }
      for (int e = 0; e < count; ++e, column += dim)
        for (int i = 0; i < dim; ++i) own[i] -= column[i] * by[e];
    };
    take(globals.data(), na);
    take(globals.data() + layout_.phi_count, ns);
    for (int landmark : node.landmarks) take(globals.data() + layout_.landmark_begin + 2 * landmark, 2);
  }
  return solve_stops(std::move(rhs));
}

Eigen::MatrixXd JointSystem::dense_hessian() const {
  const Eigen::Index p = layout_.global_count, n = p + static_cast<Eigen::Index>(layout_.coordinates);
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(n, n);
  dense.topLeftCorner(p, p) = hessian_.selfadjointView<Eigen::Upper>();
  for (std::size_t j = 0; j < layout_.nodes.size(); ++j) {
    const JointLayout::Node& node = layout_.nodes[j];
    const NodeView b(node, arena_.data());
    const Eigen::Index at = p + static_cast<Eigen::Index>(node.coordinate);
    dense.block(at, at, node.dim, node.dim) = b.H;
    for (int e = 0; e < node.columns; ++e) {
      dense.block(at, b.global_of(e, layout_), node.dim, 1) = b.G.col(e);
      dense.block(b.global_of(e, layout_), at, 1, node.dim) = b.G.col(e).transpose();
    }
    if (!node.chained) continue;
    const Eigen::Index before = p + static_cast<Eigen::Index>(layout_.nodes[j - 1].coordinate);
    dense.block(at, before, link_[j].rows(), link_[j].cols()) = link_[j];
    dense.block(before, at, link_[j].cols(), link_[j].rows()) = link_[j].transpose();
  }
  return dense;
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
