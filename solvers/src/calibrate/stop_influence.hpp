// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// What each stop says of the globals theta = (alpha, landmarks, sigmas) of a marginal fit, and where the fit would be
/// without it.
///
/// The marginal NLL is a sum over groups k of independent stops, l_k(theta), plus the priors. With g_k and H_k its gradient
/// and Hessian at the estimate, H their sum with the priors', and C the covariance stated there, one Newton step without
/// group k ends at
///
///   theta_(k) = theta + C (I - H_k H^-1)^-1 (g_k - mean g),
///
/// and the spread of these is the standard deviation that needs no noise law, shape or independence of readings within
/// a stop (jackknife form of the sandwich, CR3: Bell and McCaffrey 2002):
///
///   V = (K - 1) / K sum_k (theta_(k) - mean) (theta_(k) - mean)^T.
struct StopInfluence {
  std::vector<std::vector<int>> stops;    ///< of each group
  std::vector<Eigen::VectorXd> left_out;  ///< theta_(k) - theta
  Eigen::MatrixXd covariance;             ///< V
  /// alpha from the first half of the groups less that from the second, and the covariance C says it has; empty where a
  /// half alone does not determine them.
  Eigen::VectorXd halves_difference;
  Eigen::MatrixXd halves_covariance;

  int groups() const { return static_cast<int>(stops.size()); }
};

/// `problem`: what the fit's scores at `state` are those of (weighted_problem where there is a noise shape); `covariance`
/// of theta as the fit states it, zero in what was held. At most 500 groups, of consecutive places. None along a
/// random walk, whose stops depend on each other, for fewer than 4 places, and where a group alone determines a direction.
/// Cost: linear in the cells, and groups times theta cubed.
std::optional<StopInfluence> stop_influence(const JointProblem& problem, const JointState& state,
                                            const Eigen::MatrixXd& covariance);

}  // namespace rangecal
