// SPDX-License-Identifier: BSD-3-Clause
// The random walk: links between neighbouring nodes, and the elimination of the block-tridiagonal chain they make.
#include <Eigen/Cholesky>
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "joint_ml/chain_link.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

double JointSystem::assemble_chain_links(const JointState& state, HessianKind kind) {
  const bool exact = kind == HessianKind::exact;
  const int sigma_column = layout_.alpha_count + layout_.sigma_count() - 1;
  for (std::size_t j = 0; j < link_.size(); ++j)
    link_[j].setZero(layout_.nodes[j].chained ? layout_.nodes[j].dim : 0,
                     layout_.nodes[j].chained ? layout_.nodes[j - 1].dim : 0);
  double nll = 0.0;
  for (int k = 1; k < problem_.stop_count(); ++k) {
    const StopPrior& prior = problem_.stops[k];
    if (!prior.chained) continue;
    const LinkCoordinates at(layout_, k);
    const ChainLink link(problem_.stops[k - 1], prior, state.stops[k - 1], state.stops[k]);
    const StopInformation information(prior, sigma_xy_of(problem_, state, k));
    const Eigen::Vector3d error = link.error(), pull = information.W * error;
    nll += 0.5 * error.dot(pull) + information.log_scale;

    const ChainLink::Vector6 gradient = link.jacobian().transpose() * pull;
    const ChainLink::Matrix6 hessian = link.hessian(information.W, exact);
    // A step with a covariance of its own does not share sigma_s: W has no entry between position and heading
    // here.
    const bool sigma_free = information.position && layout_.sigma_s >= 0 && problem_.sigma_s_shared[k];
    const double chi_sq = error.head<2>().dot(pull.head<2>());
    const ChainLink::Vector6 position_gradient = link.jacobian().topRows<2>().transpose() * pull.head<2>();
    if (sigma_free) {
      gradient_[layout_.sigma_s] += 2.0 - chi_sq;
      hessian_(layout_.sigma_s, layout_.sigma_s) += exact ? 2.0 * chi_sq : 4.0;
    }
    for (int a = 0; a < 6; ++a) {
      if (at.coordinate[a] < 0) continue;
      const JointLayout::Node& node = layout_.nodes[at.node_of(a)];
      NodeBlocks<Eigen::Dynamic> b(node, arena_.data(), stop_gradient_.data());
      b.g[at.coordinate[a]] += gradient[a];
      if (sigma_free && exact) b.G(at.coordinate[a], sigma_column) -= 2.0 * position_gradient[a];
      for (int e = 0; e < 6; ++e) {
        if (at.coordinate[e] < 0) continue;
        if (at.node_of(a) == at.node_of(e))
          b.H(at.coordinate[a], at.coordinate[e]) += hessian(a, e);
        else if (at.node_of(a) == at.node1)
          link_[at.node1](at.coordinate[a], at.coordinate[e]) += hessian(a, e);
      }
    }
  }
  return nll;
}

namespace {

/// f<D>(), D the dimension of a node and of the one before it, where they agree and are known when compiled.
template <typename Function>
auto with_link_dimension(const JointLayout& layout, std::size_t j, const Function& f) {
  const JointLayout::Node& node = layout.nodes[j];
  const bool alike = !node.chained || layout.nodes[j - 1].dim == node.dim;
  return with_dimension(alike ? node.dim : Eigen::Dynamic, f);
}

}  // namespace

// The Hessian of a chain is L L^T, L block-bidiagonal: L_j the factor of H_j - B_j B_j^T, B_j = O_j L_{j-1}^-T the block to
// the left of it, O_j = H_{j,j-1}.

template <int D>
bool JointSystem::factor_link(std::size_t j, double damping) {
  using Square = Eigen::Matrix<double, D, D>;
  const JointLayout::Node& node = layout_.nodes[j];
  NodeBlocks<D> b(node, arena_.data(), stop_gradient_.data());
  const Square own = b.H;
  b.H.diagonal() *= 1.0 + damping;
  if (node.chained) {
    const JointLayout::Node& before = layout_.nodes[j - 1];
    const NodeBlocks<D> a(before, arena_.data(), stop_gradient_.data());
    const Eigen::Map<const Square> link(link_[j].data(), node.dim, before.dim);
    const Square half = a.L.template triangularView<Eigen::Lower>().solve(link.transpose());
    b.H -= half.transpose() * half;
    link_half_[j] = half;
  }
  const bool good = factor_node(b, 0.0, log_det_stops_);
  b.H = own;
  return good;
}

bool JointSystem::factor_chain(double damping) {
  log_det_stops_ = 0.0;
  for (std::size_t j = 0; j < layout_.nodes.size(); ++j)
    if (!with_link_dimension(layout_, j, [&]<int D>() { return factor_link<D>(j, damping); })) return false;
  return true;
}

/// The columns of (L^-1 (G, g))^T that are the node's.
template <int D>
void JointSystem::eliminate_link(std::size_t j) {
  const JointLayout::Node& node = layout_.nodes[j];
  const int p = layout_.global_count;
  const NodeBlocks<D> b(node, arena_.data(), stop_gradient_.data());
  auto own = chain_half_.middleCols<D>(node.coordinate, node.dim);
  own.setZero();
  for (int e = 0; e < node.columns; ++e) own.row(b.global_of(e, layout_)) += b.G.col(e).transpose();
  own.row(p) = b.g.transpose();
  if (node.chained) {
    const JointLayout::Node& before = layout_.nodes[j - 1];
    const Eigen::Map<const Eigen::Matrix<double, D, D>> half(link_half_[j].data(), before.dim, node.dim);
    own -= chain_half_.middleCols<D>(before.coordinate, before.dim).lazyProduct(half);
  }
  for (int i = 0; i < node.dim; ++i) {
    for (int k = 0; k < i; ++k) own.col(i) -= b.L(i, k) * own.col(k);
    own.col(i) /= b.L(i, i);
  }
}

void JointSystem::eliminate_chain(double damping) {
  const int p = layout_.global_count;
  chain_half_.resize(p + 1, static_cast<Eigen::Index>(layout_.coordinates));
  for (std::size_t j = 0; j < layout_.nodes.size(); ++j)
    with_link_dimension(layout_, j, [&]<int D>() { eliminate_link<D>(j); });
  Eigen::MatrixXd schur = Eigen::MatrixXd::Zero(p, p);
  schur.selfadjointView<Eigen::Upper>().rankUpdate(chain_half_.topRows(p), -1.0);
  schur.diagonal() += (1.0 + damping) * hessian_.diagonal();
  schur.triangularView<Eigen::StrictlyUpper>() += hessian_;
  schur_ = schur.selfadjointView<Eigen::Upper>();
  reduced_gradient_ = gradient_ - chain_half_.topRows(p) * chain_half_.row(p).transpose();
}

/// After eliminate, chained: U^T = (H^-1 G)^T over phi.
Eigen::MatrixXd JointSystem::coupling_solved() const {
  Eigen::MatrixXd U = chain_half_.topRows(layout_.phi_count);
  for (std::size_t j = layout_.nodes.size(); j-- > 0;)
    with_link_dimension(layout_, j, [&]<int D>() {
      const JointLayout::Node& node = layout_.nodes[j];
      const auto L = NodeView(node, arena_.data()).L;
      auto own = U.middleCols<D>(node.coordinate, node.dim);
      for (int i = node.dim; i-- > 0;) {
        for (int k = i + 1; k < node.dim; ++k) own.col(i) -= L(k, i) * own.col(k);
        own.col(i) /= L(i, i);
      }
      if (!node.chained) return;
      const JointLayout::Node& before = layout_.nodes[j - 1];
      const Eigen::Map<const Eigen::Matrix<double, D, D>> half(link_half_[j].data(), before.dim, node.dim);
      U.middleCols<D>(before.coordinate, before.dim) -= own.lazyProduct(half.transpose());
    });
  return U;
}

/// Takes from the stops before a node what its own, solved for, pull.
template <int D>
void JointSystem::substitute_link(std::size_t j, double* u) const {
  using Column = Eigen::Matrix<double, D, 1>;
  const JointLayout::Node &node = layout_.nodes[j], &before = layout_.nodes[j - 1];
  const Eigen::Map<const Eigen::Matrix<double, D, D>> link(link_[j].data(), node.dim, before.dim);
  Column pull = link.transpose() * Eigen::Map<const Column>(u + node.coordinate, node.dim);
  solve_factored(NodeView(before, arena_.data()).L.data(), before.dim, pull.data());
  Eigen::Map<Column>(u + before.coordinate, before.dim) -= pull;
}

Eigen::VectorXd JointSystem::solve_stops(Eigen::VectorXd rhs) const {
  Eigen::VectorXd u = std::move(rhs);
  const std::size_t nodes = layout_.nodes.size();
  for (std::size_t j = 0; j < nodes; ++j) {
    const JointLayout::Node& node = layout_.nodes[j];
    if (node.chained)
      with_link_dimension(layout_, j, [&]<int D>() {
        using Column = Eigen::Matrix<double, D, 1>;
        const JointLayout::Node& before = layout_.nodes[j - 1];
        const Eigen::Map<const Eigen::Matrix<double, D, D>> link(link_[j].data(), node.dim, before.dim);
        Eigen::Map<Column>(u.data() + node.coordinate, node.dim) -=
            link * Eigen::Map<const Column>(u.data() + before.coordinate, before.dim);
      });
    solve_factored(NodeView(node, arena_.data()).L.data(), node.dim, u.data() + node.coordinate);
  }
  if (!layout_.chained) return u;
  for (std::size_t j = nodes - 1; j > 0; --j)
    if (layout_.nodes[j].chained)
      with_link_dimension(layout_, j, [&]<int D>() { substitute_link<D>(j, u.data()); });
  return u;
}

/// The diagonal block of H^-1 of a node, from that of the next one, and the block below it.
template <int D>
void JointSystem::invert_link(std::size_t j) const {
  using Square = Eigen::Matrix<double, D, D>;
  const JointLayout::Node &node = layout_.nodes[j], &next = layout_.nodes[j + 1];
  Eigen::Map<Square> own(inverse_diagonal_.data() + inverse_begin_[j], node.dim, node.dim);
  const Eigen::Map<const Square> link(link_[j + 1].data(), next.dim, node.dim);
  const Eigen::Map<const Square> following(inverse_of_node(next), next.dim, next.dim);
  // C_jj = H'^-1 + H'^-1 O^T C_next O H'^-1
  const Square pull = link * own;
  const Square below = -following * pull;  // C_{j+1,j}
  inverse_below_[j + 1] = below;
  own -= pull.transpose() * below;
}

void JointSystem::selected_inverse() const {
  if (inverse_valid_) return;
  const std::size_t nodes = layout_.nodes.size();
  if (inverse_begin_.empty()) {
    std::size_t squares = 0;
    for (const JointLayout::Node& node : layout_.nodes) {
      inverse_begin_.push_back(squares);
      squares += static_cast<std::size_t>(node.dim) * node.dim;
    }
    inverse_diagonal_.resize(squares);
  }
  inverse_below_.resize(layout_.chained ? nodes : 0);
  for (std::size_t j = nodes; j-- > 0;) {
    const JointLayout::Node& node = layout_.nodes[j];
    const int dim = node.dim;
    double* const inverse = inverse_diagonal_.data() + inverse_begin_[j];
    std::fill_n(inverse, dim * dim, 0.0);
    for (int i = 0; i < dim; ++i) {
      inverse[i * dim + i] = 1.0;
      solve_factored(NodeView(node, arena_.data()).L.data(), dim, inverse + i * dim);
    }
    if (j + 1 < nodes && layout_.nodes[j + 1].chained)
      with_link_dimension(layout_, j + 1, [&]<int D>() { invert_link<D>(j); });
  }
  inverse_valid_ = true;
}

Eigen::MatrixXd JointSystem::stop_covariance(int node) const {
  selected_inverse();
  return inverse_of(layout_.nodes[node]);
}

}  // namespace rangecal
