// SPDX-License-Identifier: BSD-3-Clause
// The gradient of 1/2 log det A, A the Hessian in phi with the stops eliminated: what REML adds to the criterion.
#include <algorithm>
#include <vector>

#include "joint_ml/blocks.hpp"
#include "joint_ml/trace_gradient.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

/// M = (1, -U)^T P (1, -U), P the covariance of phi and U = H_ss^-1 G, as trace_gradient() reads it. Independent stops
/// have the rows of U made as they are entered, over the globals that they touch; a chain has them over all of phi.
class PhiCovariance {
 public:
  PhiCovariance(const JointLayout& layout, const std::vector<double>& arena, const Eigen::MatrixXd& P,
                Eigen::MatrixXd chain_U)
      : layout_(layout),
        arena_(arena),
        P_(P),
        chain_U_(std::move(chain_U)),
        chain_Q_(layout.chained ? Eigen::MatrixXd(P * chain_U_) : Eigen::MatrixXd()),
        na_(layout.alpha_count),
        alpha_alpha_(na_ * na_),
        alpha_x_(na_),
        alpha_y_(na_) {
    for (int a = 0; a < na_; ++a)
      for (int b = 0; b < na_; ++b) alpha_alpha_[a * na_ + b] = P(a, b);
  }

  static constexpr bool with_alpha = true;
  const double* alpha_alpha() const { return alpha_alpha_.data(); }

  void enter(const JointLayout::Node& node) {
    dim_ = node.dim;
    moves_ = node.free_position;
    set_columns(node);
    // Q = U P, UPU = U P U^T; all row by row.
    Q_.assign(static_cast<std::size_t>(dim_) * columns_, 0.0);
    if (layout_.chained) {
      std::copy_n(chain_Q_.data() + static_cast<std::size_t>(node.coordinate) * columns_, Q_.size(),
                  Q_.data());
    } else {
      for (int r = 0; r < dim_; ++r)
        for (int i = 0; i < columns_; ++i) {
          const double u = U_[r * columns_ + i];
          const double* row = own_.data() + static_cast<std::size_t>(i) * columns_;
          double* const to = Q_.data() + r * columns_;
          for (int j = 0; j < columns_; ++j) to[j] += u * row[j];
        }
    }
    UPU_.resize(static_cast<std::size_t>(dim_) * dim_);
    for (int r = 0; r < dim_; ++r)
      for (int e = 0; e <= r; ++e) {
        double sum = 0.0;
        for (int i = 0; i < columns_; ++i) sum += Q_[r * columns_ + i] * U_[e * columns_ + i];
        UPU_[r * dim_ + e] = UPU_[e * dim_ + r] = sum;
      }
  }
  double position_trace() const { return moves_ ? UPU_[0] + UPU_[dim_ + 1] : 0.0; }

  void cell(int heading, int landmark, int slot, SightCovariance& c) {
    const int x = na_ + 2 * (layout_.chained ? landmark : slot), y = x + 1;
    const double *px = own_.data() + static_cast<std::size_t>(x) * columns_, *py = px + columns_;
    c.xx = px[x];
    c.xy = px[y];
    c.yy = py[y];
    std::copy_n(px, na_, alpha_x_.data());
    std::copy_n(py, na_, alpha_y_.data());
    c.alpha_x = alpha_x_.data();
    c.alpha_y = alpha_y_.data();
    const double *q0 = Q_.data(), *q1 = q0 + columns_,
                 *qh = q0 + static_cast<std::size_t>(std::max(heading, 0)) * columns_;
    if (moves_) {
      c.xx += 2.0 * q0[x] + UPU_[0];
      c.xy += q0[y] + q1[x] + UPU_[1];
      c.yy += 2.0 * q1[y] + UPU_[dim_ + 1];
      for (int a = 0; a < na_; ++a) {
        alpha_x_[a] += q0[a];
        alpha_y_[a] += q1[a];
      }
    }
    c.xh = heading < 0 ? 0.0 : qh[x] + (moves_ ? UPU_[heading * dim_] : 0.0);
    c.yh = heading < 0 ? 0.0 : qh[y] + (moves_ ? UPU_[heading * dim_ + 1] : 0.0);
    c.hh = heading < 0 ? 0.0 : UPU_[heading * dim_ + heading];
  }
  double between(int node_a, int p, int node_b, int q) const {
    return chain_U_.col(layout_.nodes[node_a].coordinate + p)
        .dot(chain_Q_.col(layout_.nodes[node_b].coordinate + q));
  }
  double landmarks(int i, int j) const { return P_(i, j); }

 private:
  /// P and U over the columns that the node touches.
  void set_columns(const JointLayout::Node& node) {
    const int before = columns_;
    columns_ = layout_.chained ? layout_.phi_count : na_ + 2 * static_cast<int>(node.landmarks.size());
    if (!layout_.chained &&
        (columns_ != before || !std::equal(seen_.begin(), seen_.end(), node.landmarks.begin()))) {
      seen_.assign(node.landmarks.begin(), node.landmarks.end());
      gather([&](int i) {
        return i < na_ ? i : layout_.landmark_begin + 2 * seen_[(i - na_) / 2] + (i - na_) % 2;
      });
    } else if (layout_.chained && before == 0) {
      gather([](int i) { return i; });
    }
    U_.resize(static_cast<std::size_t>(dim_) * columns_);
    if (layout_.chained) {
      std::copy_n(chain_U_.data() + static_cast<std::size_t>(node.coordinate) * columns_, U_.size(),
                  U_.data());
      return;
    }
    const double *L = arena_.data() + node.block + dim_ * dim_, *G = L + dim_ * dim_;
    solved_.resize(dim_);
    for (int i = 0; i < columns_; ++i) {
      const double* column = G + static_cast<std::size_t>(i < na_ ? i : i + layout_.sigma_count()) * dim_;
      std::copy_n(column, dim_, solved_.data());
      solve_factored(L, dim_, solved_.data());
      for (int r = 0; r < dim_; ++r) U_[r * columns_ + i] = solved_[r];
    }
  }
  template <typename Global>
  void gather(const Global& global) {
    own_.resize(static_cast<std::size_t>(columns_) * columns_);
    for (int i = 0; i < columns_; ++i)
      for (int j = 0; j < columns_; ++j) own_[i * columns_ + j] = P_(global(i), global(j));
  }

  const JointLayout& layout_;
  const std::vector<double>& arena_;
  const Eigen::MatrixXd& P_;
  Eigen::MatrixXd chain_U_, chain_Q_;  ///< transposed: a column for each stop coordinate
  int na_, dim_ = 0, columns_ = 0;
  bool moves_ = false;
  std::vector<int> seen_;
  std::vector<double> alpha_alpha_, alpha_x_, alpha_y_, own_, U_, Q_, UPU_, solved_;
};

}  // namespace

Eigen::VectorXd JointSystem::log_det_phi_gradient(const JointState& state,
                                                  const Eigen::MatrixXd& phi_covariance) const {
  PhiCovariance covariance(layout_, arena_, phi_covariance,
                           layout_.chained ? coupling_solved() : Eigen::MatrixXd());
  return trace_gradient(state, covariance);
}

}  // namespace rangecal
