// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/landmarks/range_term.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// The line of sight from a stop to a landmark.
struct Sight {
  Sight() = default;
  Sight(const Eigen::Vector2d& landmark, const Pose2& pose, double radius_m) {
    const Eigen::Vector2d v(landmark.x() - pose.x_m, landmark.y() - pose.y_m);
    axis_distance = v.norm();
    d = axis_distance - radius_m;
    n = v / axis_distance;
    t = Eigen::Vector2d(-n.y(), n.x());
    bearing = std::atan2(v.y(), v.x()) - pose.heading_rad;
  }
  double axis_distance = 0.0, d = 0.0,
         bearing = 0.0;  ///< |m - p| [m], surface distance [m], direction in the sensor frame [rad]
  Eigen::Vector2d n, t;  ///< unit vector stop -> landmark, and across
};

/// The global that a column of a node's G stands for: alpha, sigmas, then the node's landmarks.
inline int global_column(const JointLayout::Node& node, const JointLayout& layout, int column) {
  if (column < layout.alpha_count) return column;
  const int after_alpha = column - layout.alpha_count;
  if (after_alpha < layout.sigma_count()) return layout.phi_count + after_alpha;
  const int after_sigma = after_alpha - layout.sigma_count();
  return layout.landmark_begin + 2 * node.landmarks[after_sigma / 2] + after_sigma % 2;
}

/// A node's doubles in the arena: H, its Cholesky factor L, and G, column-major; its gradient in the stop vector.
template <int D>
struct NodeBlocks {
  using Square = Eigen::Matrix<double, D, D>;
  NodeBlocks(const JointLayout::Node& owner, double* arena, double* stop_gradient)
      : node(owner),
        H(arena + owner.block, owner.dim, owner.dim),
        L(arena + owner.block + owner.dim * owner.dim, owner.dim, owner.dim),
        G(arena + owner.block + 2 * owner.dim * owner.dim, owner.dim, owner.columns),
        g(stop_gradient + owner.coordinate, owner.dim) {}

  int global_of(int column, const JointLayout& layout) const { return global_column(node, layout, column); }

  const JointLayout::Node& node;
  Eigen::Map<Square> H, L;
  Eigen::Map<Eigen::Matrix<double, D, Eigen::Dynamic>> G;
  Eigen::Map<Eigen::Matrix<double, D, 1>> g;
};

/// The same for reading only.
struct NodeView {
  NodeView(const JointLayout::Node& owner, const double* arena)
      : node(owner),
        H(arena + owner.block, owner.dim, owner.dim),
        L(arena + owner.block + owner.dim * owner.dim, owner.dim, owner.dim),
        G(arena + owner.block + 2 * owner.dim * owner.dim, owner.dim, owner.columns) {}

  int global_of(int column, const JointLayout& layout) const { return global_column(node, layout, column); }

  const JointLayout::Node& node;
  Eigen::Map<const Eigen::MatrixXd> H, L, G;
};

/// f<D>(), D the dimension of a node where that is known when compiled.
template <typename Function>
auto with_dimension(int dim, const Function& f) {
  return dim == 2   ? f.template operator()<2>()
         : dim == 3 ? f.template operator()<3>()
                    : f.template operator()<Eigen::Dynamic>();
}

/// L L^T = H with its diagonal scaled by (1 + damping); adds log det H. False if H is not positive definite.
template <int D>
bool factor_node(NodeBlocks<D>& b, double damping, double& log_det) {
  const int dim = b.node.dim;
  b.L = b.H;
  b.L.diagonal() *= 1.0 + damping;
  for (int j = 0; j < dim; ++j) {
    double pivot = b.L(j, j);
    for (int k = 0; k < j; ++k) pivot -= b.L(j, k) * b.L(j, k);
    if (!(pivot > 0.0)) return false;
    log_det += std::log(pivot);
    const double root = std::sqrt(pivot);
    b.L(j, j) = root;
    for (int i = j + 1; i < dim; ++i) {
      double value = b.L(i, j);
      for (int k = 0; k < j; ++k) value -= b.L(i, k) * b.L(j, k);
      b.L(i, j) = value / root;
    }
  }
  return true;
}

/// x = (L L^T)^-1 x, L column-major.
inline void solve_factored(const double* L, int dim, double* x) {
  for (int i = 0; i < dim; ++i) {
    for (int k = 0; k < i; ++k) x[i] -= L[k * dim + i] * x[k];
    x[i] /= L[i * dim + i];
  }
  for (int i = dim; i-- > 0;) {
    for (int k = i + 1; k < dim; ++k) x[i] -= L[i * dim + k] * x[k];
    x[i] /= L[i * dim + i];
  }
}

}  // namespace rangecal
