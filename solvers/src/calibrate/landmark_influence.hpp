// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// How much each landmark influences alpha of a marginal fit: where the fit would be without it.
///
/// The stops are integrated out and see all landmarks, so that the marginal NLL is no sum over landmarks. Let l_(i) be the marginal
/// NLL without the readings of group i of landmarks, g_(i) and H_(i) its gradient and Hessian in theta = (alpha, the other
/// landmarks, sigmas) at the estimate, with the stops at their optimum without them; H the Hessian of all readings and C the
/// covariance stated there. One Newton step ends at
///
///   theta_(i) = theta - C H H_(i)^-1 g_(i)        (C H = 1 for Gaussian noise),
///
/// and the spread of the G alpha_(i) gives a covariance that holds where the readings of a landmark have an error in common
/// (jackknife: Efron and Stein 1981). What moves all landmarks at once, the error of the stops' commanded poses, it does not see:
/// that is added as the model has it. With H_ss the Hessian in the stops' coordinates, B its coupling to theta, and P the part of H_ss
/// that the poses' prior has,
///
///   V = (G - 1) / G sum_i (alpha_(i) - mean) (alpha_(i) - mean)^T  +  C B^T H_ss^-1 P H_ss^-1 B C.
///
/// A landmark's own place has no such covariance: an error that all of its readings share moves it unseen.
struct LandmarkInfluence {
  int groups = 0;             ///< G
  Eigen::MatrixXd jackknife;  ///< the first part of V
  Eigen::MatrixXd of_poses;   ///< the second
  /// Covariance of alpha_(i) - alpha, of each group, if the model holds: C_(i) - C. The first part then is `per_group` times their
  /// sum.
  std::vector<Eigen::MatrixXd> expected;
  double per_group = 1.0;

  Eigen::MatrixXd covariance() const { return jackknife + of_poses; }  ///< V
};

/// `problem`, `state`, `covariance`: as for stop_influence; `labels`: of its landmarks, those of one label, of several recordings, are
/// one. At most 50 groups. None where no more landmarks are seen than places read one, for fewer than 4 landmarks, and if the readings
/// without some landmark do not determine what is free. Cost: groups times that of a Newton step; the poses' part is quadratic in the
/// stops.
std::optional<LandmarkInfluence> landmark_influence(const JointProblem& problem,
                                                    const std::vector<std::string>& labels,
                                                    const JointState& state,
                                                    const Eigen::MatrixXd& covariance);

}  // namespace rangecal
