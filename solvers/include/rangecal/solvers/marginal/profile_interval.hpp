// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal {

/// Where a standard deviation may lie, in its own unit.
struct ProfileInterval {
  double low = 0.0, high = std::numeric_limits<double>::infinity();
};

/// The interval of a sigma of `marginal` by the profile of its REML criterion: the values at which the
/// criterion, minimised over all else, lies within half the quantile of chi-square(1) of its minimum. low is
/// 0 where the profile never rises that far on the way there. `state`: where solve_marginal converged.
/// `relative_std`: about its standard deviation over its value, where to begin; 0: unknown. None for the law
/// `polynomial` (its betas are no scale), for a sigma that was not estimated, and where a solve on the way
/// has no optimum. Cost: 10 to 20 marginal solves from warm starts.
std::optional<ProfileInterval> profile_interval(const JointProblem& problem, const JointState& state,
                                                Sigma which, double relative_std = 0.0, double level = 0.95);

/// How the covariance C of phi = (alpha, landmarks) given the sigmas goes with them, and how well these are
/// known: what Satterthwaite's degrees of freedom of an interval are made of.
///
///   nu(c) = 2 V^2 / (g^T W g),   V = c^T C c,   g_j = c^T (dC / dsigma_j) c,   W the covariance of the
///   sigmas
///
/// (Satterthwaite 1946; Giesbrecht and Burns 1985 for REML.) sigma_j: logs, or beta of the law `polynomial`.
struct SigmaSlopes {
  Eigen::MatrixXd covariance, sigma_covariance;
  std::vector<Eigen::MatrixXd> slopes;  ///< dC / dsigma_j, by differences

  /// Of the interval of contrast . phi; infinity where the sigmas do not matter to it.
  double degrees_of_freedom(const Eigen::VectorXd& contrast) const;
};

/// None where an information matrix is not positive definite. `state`: where solve_marginal converged. Cost:
/// two passes with their stops settled per sigma.
std::optional<SigmaSlopes> sigma_slopes(const JointProblem& problem, const JointState& state);

}  // namespace rangecal
