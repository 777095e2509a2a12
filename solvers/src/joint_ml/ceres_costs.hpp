// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/cost_function.h>
#include <ceres/sized_cost_function.h>

#include <algorithm>
#include <utility>
#include <vector>

#include "joint_ml/chain_link.hpp"
#include "rangecal/problems/landmarks/cell_residual.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// CellResidual with its floor at the blocks given.
class CellCost : public ceres::CostFunction {
 public:
  explicit CellCost(CellResidual residual) : residual_(std::move(residual)) {
    set_num_residuals(residual_.residual_count());
    *mutable_parameter_block_sizes() = residual_.block_sizes();
  }
  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    return residual_.evaluate(blocks, nullptr, residuals, jacobians);
  }
  CellResidual& residual() { return residual_; }

 private:
  CellResidual residual_;
};

class StopPriorCost : public ceres::CostFunction {
 public:
  explicit StopPriorCost(const StopPriorResidual& residual) : residual_(residual) {
    set_num_residuals(residual_.residual_count());
    mutable_parameter_block_sizes()->push_back(residual_.stop.size);
  }
  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    residual_.evaluate(blocks[0], residuals, jacobians ? jacobians[0] : nullptr);
    return true;
  }

 private:
  StopPriorResidual residual_;
};

class BearingSpreadCost : public ceres::CostFunction {
 public:
  explicit BearingSpreadCost(BearingSpreadResidual residual) : residual_(residual) {
    set_num_residuals(3);
    mutable_parameter_block_sizes()->push_back(residual.block_size);
  }
  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    return residual_.evaluate(blocks[0], nullptr, residuals, jacobians ? jacobians[0] : nullptr);
  }
  BearingSpreadResidual& residual() { return residual_; }

 private:
  BearingSpreadResidual residual_;
};

/// One link of a random walk: R e over the increment and the turn, R^T R = C^-1, the rows of what has a
/// prior. Blocks: the coordinates of the stop's place, and of the place before where it is another one.
class LinkCost : public ceres::CostFunction {
 public:
  LinkCost(const JointProblem& problem, const JointLayout& layout, const JointState& reference, int stop)
      : problem_(problem), reference_(reference), stop_(stop), at_(layout, stop) {
    const StopInformation information(problem.stops[stop], sigma_xy_of(problem, reference, stop));
    root_ = information.root();
    first_ = information.position ? 0 : 2;
    set_num_residuals((information.position ? 2 : 0) + (information.heading ? 1 : 0));
    for (int node : {at_.node0, at_.node1}) {
      if (layout.nodes[node].dim == 0 || (!nodes_.empty() && nodes_[0] == node)) continue;
      nodes_.push_back(node);
      mutable_parameter_block_sizes()->push_back(layout.nodes[node].dim);
    }
  }
  const std::vector<int>& nodes() const { return nodes_; }

  bool Evaluate(double const* const* blocks, double* residuals, double** jacobians) const override {
    Pose2 from = reference_.stops[stop_ - 1], to = reference_.stops[stop_];
    double* moved[6] = {&from.x_m, &from.y_m, &from.heading_rad, &to.x_m, &to.y_m, &to.heading_rad};
    for (int e = 0; e < 6; ++e)
      if (at_.coordinate[e] >= 0) *moved[e] += blocks[block_of(at_.node_of(e))][at_.coordinate[e]];
    const ChainLink link(problem_.stops[stop_ - 1], problem_.stops[stop_], from, to);
    const Eigen::Vector3d white = root_ * link.error();
    std::copy_n(white.data() + first_, num_residuals(), residuals);
    if (!jacobians) return true;
    const Eigen::Matrix<double, 3, 6> slope = root_ * link.jacobian();
    for (std::size_t b = 0; b < nodes_.size(); ++b)
      if (jacobians[b]) std::fill_n(jacobians[b], num_residuals() * parameter_block_sizes()[b], 0.0);
    for (int e = 0; e < 6; ++e) {
      if (at_.coordinate[e] < 0) continue;
      const int block = block_of(at_.node_of(e)), size = parameter_block_sizes()[block];
      if (!jacobians[block]) continue;
      for (int i = 0; i < num_residuals(); ++i)
        jacobians[block][i * size + at_.coordinate[e]] += slope(first_ + i, e);
    }
    return true;
  }

 private:
  int block_of(int node) const { return nodes_[0] == node ? 0 : 1; }

  const JointProblem& problem_;
  const JointState& reference_;
  int stop_;
  LinkCoordinates at_;
  Eigen::Matrix3d root_;
  int first_;  ///< row of root_ that is the first residual
  std::vector<int> nodes_;
};

/// (|m_a - m_b| - t) / sigma_t
class TapedCost : public ceres::SizedCostFunction<1, 2, 2> {
 public:
  explicit TapedCost(const KnownDistance& taped) : taped_(taped) {}
  bool Evaluate(double const* const* m, double* residuals, double** jacobians) const override {
    const Eigen::Vector2d v(m[1][0] - m[0][0], m[1][1] - m[0][1]);
    const double length = v.norm(), weight = 1.0 / taped_.sigma_m;
    residuals[0] = weight * (length - taped_.distance_m);
    for (int b = 0; jacobians && b < 2; ++b) {
      if (!jacobians[b]) continue;
      const double factor = (b ? weight : -weight) / length;
      jacobians[b][0] = factor * v.x();
      jacobians[b][1] = factor * v.y();
    }
    return length > 0.0;
  }

 private:
  KnownDistance taped_;
};

}  // namespace rangecal
