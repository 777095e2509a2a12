// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// Indices of the globals that may move.
inline std::vector<int> free_globals(const JointLayout& layout, const Held& held) {
  std::vector<int> free;
  for (int i = 0; i < layout.global_count; ++i) {
    const bool fixed = i < layout.landmark_begin ? held.alpha
                       : i < layout.phi_count    ? held.landmarks
                                                 : held.sigmas;
    if (!fixed) free.push_back(i);
  }
  return free;
}

/// -hessian^-1 gradient over the `free` indices, zero elsewhere. None if the hessian is not positive definite there.
inline std::optional<Eigen::VectorXd> newton_step(const Eigen::MatrixXd& hessian,
                                                  const Eigen::VectorXd& gradient,
                                                  const std::vector<int>& free) {
  const Eigen::Index n = static_cast<Eigen::Index>(free.size());
  Eigen::VectorXd step = Eigen::VectorXd::Zero(gradient.size());
  if (n == 0) return step;
  Eigen::MatrixXd own(n, n);
  Eigen::VectorXd moved(n);
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index i = j; i < n; ++i) own(i, j) = hessian(free[i], free[j]);
    moved[j] = -gradient[free[j]];
  }
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>> factor(own);
  if (factor.info() != Eigen::Success) return std::nullopt;
  factor.solveInPlace(moved);
  for (Eigen::Index j = 0; j < n; ++j) step[free[j]] = moved[j];
  return step;
}

/// Shrinks a step so that no log-sigma moves by more than `limit`. Returns the factor.
inline double limit_step(const JointLayout& layout, NoiseLaw law, Eigen::VectorXd& globals,
                         double limit = 1.5) {
  double largest = std::abs(globals[layout.sigma_theta]);
  if (has_sigma(law)) largest = std::max(largest, std::abs(globals[layout.tau_begin]));
  if (layout.sigma_s >= 0) largest = std::max(largest, std::abs(globals[layout.sigma_s]));
  const double factor = largest > limit ? limit / largest : 1.0;
  globals *= factor;
  return factor;
}

/// Covariance of the free globals from a Hessian, or why there is none; names the weakest direction.
void describe_covariance(const Eigen::MatrixXd& hessian, const JointLayout& layout,
                         const std::vector<int>& free, JointFit& fit);

}  // namespace rangecal
