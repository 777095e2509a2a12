// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// How much each stop influences the globals theta = (alpha, landmarks, sigmas) of a marginal fit: where the fit would be
/// without it.
///
/// The marginal NLL is a sum over groups k of independent stops, l_k(theta), plus the priors. With g_k and H_k the gradient and
/// Hessian of l_k at the estimate, H the sum of the H_k and the priors' Hessian, and C the covariance stated there, one Newton
/// step without group k ends at
///
///   theta_(k) = theta + C (I - H_k H^-1)^-1 (g_k - mean g),
///
/// and the spread of the theta_(k) gives a covariance that assumes no noise law, no shape and no independence of the readings
/// of a stop (jackknife form of the sandwich estimator, CR3: Bell and McCaffrey 2002):
///
///   V = (K - 1) / K sum_k (theta_(k) - mean) (theta_(k) - mean)^T.
///
/// Along a random walk, whose stops depend on each other, the groups are stretches of the walk, and l_k is what stretch k adds to
/// the NLL of the stretches before it: -log p(its readings | theirs). The scores g_k of these are uncorrelated where the model
/// holds (prediction-error decomposition: Schweppe 1965). The stretch in which the walk begins, which alone ties the landmarks to
/// the frame, is not left out; V is that of the others times the number of all over theirs.
struct StopInfluence {
  std::vector<std::vector<int>> stops;    ///< of each group
  std::vector<Eigen::VectorXd> left_out;  ///< theta_(k) - theta
  Eigen::MatrixXd covariance;             ///< V
  /// Covariance of alpha_(k) - alpha, of each group, if the model holds: D_k, the block of C_(k) - C. That of V then is `per_group`
  /// times their sum. Empty along a random walk, where differences of Hessians say too little of it.
  std::vector<Eigen::MatrixXd> expected;
  /// Of the landmarks' places together tr(A D_k) and tr((A D_k)^2) of each group, A the diagonal matrix of 1 / (L trace of C_l), L
  /// the number of landmarks: mean and variance of the ratio of V to C, the mean over the landmarks.
  std::vector<double> expected_of_places, squares_of_places;
  double per_group = 1.0;
  /// alpha from the first half of the groups less that from the second, and its covariance by the model; empty along a random
  /// walk, and if one half alone does not determine alpha.
  Eigen::VectorXd halves_difference;
  Eigen::MatrixXd halves_covariance;

  int groups() const { return static_cast<int>(stops.size()); }
};

/// `problem`: the one that `state` is the optimum of (weighted_problem if there is a noise shape); `covariance`: that of theta
/// as the fit states it, zero for what was held. At most 500 groups, of consecutive places; along a random walk 20. None for fewer
/// than 4 groups, and if some direction is determined by one group alone. Cost: linear in the cells, along a walk times groups; and
/// groups times theta cubed.
std::optional<StopInfluence> stop_influence(const JointProblem& problem, const JointState& state,
                                            const Eigen::MatrixXd& covariance);

}  // namespace rangecal
