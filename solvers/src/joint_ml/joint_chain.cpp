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

bool JointSystem::eliminate_chain(double damping) {
  const int p = layout_.global_count;
  Eigen::MatrixXd schur = Eigen::MatrixXd::Zero(p, p);
  Eigen::VectorXd reduced = Eigen::VectorXd::Zero(p);
  log_det_stops_ = 0.0;
  for (std::size_t j = 0; j < layout_.nodes.size(); ++j) {
    const JointLayout::Node& node = layout_.nodes[j];
    NodeBlocks<Eigen::Dynamic> b(node, arena_.data(), stop_gradient_.data());
    Eigen::MatrixXd& coupling = chain_coupling_[j];
    Eigen::VectorXd& gradient = chain_gradient_[j];
    coupling.setZero(node.dim, p);
    for (int e = 0; e < node.columns; ++e) coupling.col(b.global_of(e, layout_)) += b.G.col(e);
    gradient = b.g;
    const Eigen::MatrixXd own = b.H;
    b.H.diagonal() *= 1.0 + damping;
    if (node.chained) {  // H' = H - O H'_before^-1 O^T, and the same for coupling and gradient
      const JointLayout::Node& before = layout_.nodes[j - 1];
      const NodeView a(before, arena_.data());
      const auto lower = a.L.triangularView<Eigen::Lower>();
      const Eigen::MatrixXd half = lower.solve(link_[j].transpose());
      b.H -= half.transpose() * half;
      coupling -= half.transpose() * lower.solve(chain_coupling_[j - 1]);
      gradient -= half.transpose() * lower.solve(chain_gradient_[j - 1]);
    }
    const bool good = factor_node(b, 0.0, log_det_stops_);
    b.H = own;
    if (!good) return false;
    const auto lower = b.L.triangularView<Eigen::Lower>();
    const Eigen::MatrixXd half = lower.solve(coupling);
    schur.selfadjointView<Eigen::Upper>().rankUpdate(half.transpose(), -1.0);
    reduced -= half.transpose() * lower.solve(gradient);
  }
  schur.diagonal() += (1.0 + damping) * hessian_.diagonal();
  schur.triangularView<Eigen::StrictlyUpper>() += hessian_;
  schur_ = schur.selfadjointView<Eigen::Upper>();
  reduced_gradient_ = gradient_ + reduced;
  return true;
}

Eigen::VectorXd JointSystem::solve_stops(Eigen::VectorXd rhs) const {
  Eigen::VectorXd u = std::move(rhs);
  const std::size_t nodes = layout_.nodes.size();
  for (std::size_t j = 0; j < nodes; ++j) {
    const JointLayout::Node& node = layout_.nodes[j];
    auto own = u.segment(node.coordinate, node.dim);
    if (node.chained) own -= link_[j] * u.segment(layout_.nodes[j - 1].coordinate, layout_.nodes[j - 1].dim);
    solve_factored(arena_.data() + node.block + node.dim * node.dim, node.dim, u.data() + node.coordinate);
  }
  if (!layout_.chained) return u;
  for (std::size_t j = nodes - 1; j > 0; --j) {
    const JointLayout::Node &node = layout_.nodes[j], &before = layout_.nodes[j - 1];
    if (!node.chained) continue;
    const NodeView a(before, arena_.data());
    Eigen::VectorXd pull = link_[j].transpose() * u.segment(node.coordinate, node.dim);
    a.L.triangularView<Eigen::Lower>().solveInPlace(pull);
    a.L.transpose().triangularView<Eigen::Upper>().solveInPlace(pull);
    u.segment(before.coordinate, before.dim) -= pull;
  }
  return u;
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
      solve_factored(arena_.data() + node.block + dim * dim, dim, inverse + i * dim);
    }
    if (j + 1 < nodes && layout_.nodes[j + 1].chained) {  // C_jj = H'^-1 + H'^-1 O^T C_next O H'^-1
      Eigen::Map<Eigen::MatrixXd> own(inverse, dim, dim);
      const Eigen::MatrixXd pull = link_[j + 1] * own;
      inverse_below_[j + 1] = -inverse_of(layout_.nodes[j + 1]) * pull;  // C_{j+1,j}
      own -= pull.transpose() * inverse_below_[j + 1];
    }
  }
  inverse_valid_ = true;
}

Eigen::MatrixXd JointSystem::stop_covariance(int node) const {
  selected_inverse();
  return inverse_of(layout_.nodes[node]);
}

}  // namespace rangecal
