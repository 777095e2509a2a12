// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/study/study.hpp"

namespace rangecal {

/// Cramer-Rao bounds of what a study measures.
struct StudyBound {
  double landmarks_sq = 0.0;  ///< sum over landmarks and axes of the variance bound [m^2]; 0 for pairs
  double curve_sq = 0.0;      ///< sum over the study's distances of the variance bound of f [m^2]
};

/// The scene's truth on a recording of it, stops as commanded.
struct SceneTruth {
  JointProblem problem;
  JointState state;
};
SceneTruth scene_truth(const Scene& scene, std::uint64_t seed);

/// Rows (1, d, d^2, ...), one per distance [m].
Eigen::MatrixXd curve_rows(const std::vector<double>& distances_m, int coefficients);
/// Variances of rows * alpha under the leading block of `covariance`.
Eigen::VectorXd variance_along(const Eigen::MatrixXd& rows, const Eigen::MatrixXd& covariance);

/// The bound at a point, at the true order and noise law. Landmarks: the hybrid bound over 400 draws of the stops;
/// pairs: the inverse of the expected information. None where the information is singular, and where landmarks are
/// drawn anew in every repeat (then each repeat has its own, see placement_bound).
std::optional<StudyBound> study_bound(const Study& study, const StudyPoint& point);

/// The bound of one repeat's placement of landmarks, at the commanded stops. `seen`: the recording's landmark behind
/// each landmark of the problem.
std::optional<StudyBound> placement_bound(const Study& study, const StudyPoint& point,
                                          const Recording& recording, const JointProblem& problem,
                                          const std::vector<int>& seen);

}  // namespace rangecal
