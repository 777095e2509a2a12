// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <numeric>
#include <optional>
#include <utility>

#include "joint_ml/newton_step.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal {
namespace {

std::string name_of(const JointLayout& layout, int index) {
  if (index < layout.landmark_begin) return fmt::format("alpha_{}", index);
  if (index < layout.phi_count) {
    const int landmark = (index - layout.landmark_begin) / 2;
    return fmt::format("{} of landmark {}", (index - layout.landmark_begin) % 2 ? "y" : "x", landmark);
  }
  if (index < layout.sigma_theta) return fmt::format("noise parameter {}", index - layout.tau_begin);
  return index == layout.sigma_theta ? "log sigma_theta" : "log sigma_s";
}

/// The direction in the user's parameters: its largest parts, in their own units.
std::string name_direction(const Eigen::VectorXd& direction, const JointLayout& layout,
                           const std::vector<int>& free) {
  std::vector<int> order(direction.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return std::abs(direction[a]) > std::abs(direction[b]); });
  const double largest = direction[order[0]];
  std::string text;
  for (std::size_t i = 0; i < order.size() && i < 4; ++i) {
    const double part = direction[order[i]] / largest;
    if (std::abs(part) < 0.05) break;
    text += fmt::format("{}{:+.2f} {}", i ? ", " : "", part, name_of(layout, free[order[i]]));
  }
  return text;
}

/// Inverse of a well-conditioned matrix at unit diagonal and its weakest direction there, by power iteration on the
/// inverse. False if it is not positive definite, or so nearly singular that rounding matters.
bool invert(const Eigen::MatrixXd& matrix, Eigen::MatrixXd& inverse, Eigen::VectorXd& weakest) {
  std::optional<UnitDiagonalInverse> found = unit_diagonal_inverse(matrix);
  if (!found) return false;
  inverse = std::move(found->inverse);
  Eigen::Index start = 0;
  inverse.diagonal().maxCoeff(&start);
  weakest = inverse.col(start).normalized();
  double largest = 0.0;
  for (int iteration = 0; iteration < 100; ++iteration) {
    const Eigen::VectorXd next = inverse * weakest;
    const double size = next.norm();
    weakest = next / size;
    if (std::abs(size - largest) < 1e-7 * size) break;
    largest = size;
  }
  return largest < 1e9;
}

}  // namespace

void describe_covariance(const Eigen::MatrixXd& hessian, const JointLayout& layout,
                         const std::vector<int>& free, JointFit& fit) {
  const Eigen::Index n = static_cast<Eigen::Index>(free.size());
  fit.covariance.reset();
  if (n == 0) {
    fit.covariance = Eigen::MatrixXd::Zero(layout.global_count, layout.global_count);
    return;
  }
  const Eigen::MatrixXd own = hessian(free, free);
  Eigen::VectorXd scale = own.diagonal();
  for (double& s : scale) s = s > 0.0 ? 1.0 / std::sqrt(s) : 1.0;
  Eigen::MatrixXd inverse;
  Eigen::VectorXd weakest(n);
  bool determined = invert(own, inverse, weakest);
  if (!determined) {  // near the edge: an eigenvalue decomposition decides
    const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * own * scale.asDiagonal());
    weakest = eigen.vectors.col(0);
    // Below this the direction is lost in rounding: the matrix has entries of order one and about eps * n error.
    determined = eigen.values[0] > 1e-11;
    inverse = eigen.vectors * eigen.values.cwiseInverse().asDiagonal() * eigen.vectors.transpose();
  }
  fit.weakest_direction = name_direction(scale.cwiseProduct(weakest), layout, free);
  if (!determined) {
    fit.covariance_reason = "no covariance: the recording does not determine " + fit.weakest_direction;
    if (fit.outcome == Outcome::converged) {
      fit.outcome = Outcome::unobservable;
      fit.reason = "the recording does not determine the direction " + fit.weakest_direction;
    }
    return;
  }
  fit.covariance = Eigen::MatrixXd::Zero(layout.global_count, layout.global_count);
  for (Eigen::Index j = 0; j < n; ++j)
    for (Eigen::Index i = 0; i < n; ++i)
      (*fit.covariance)(free[i], free[j]) = scale[i] * inverse(i, j) * scale[j];
}

}  // namespace rangecal
