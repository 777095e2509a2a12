// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Gradient and Hessian of the marginal NLL in the globals theta = (alpha, landmarks, sigmas), in the order of JointLayout.
struct MarginalScore {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;
};

/// None where the stops have no conditional optimum. `settled`: `state` has the stops there already; otherwise they move there
/// first. Cost: linear in the cells, and globals squared.
std::optional<MarginalScore> marginal_score(const JointProblem& problem, JointState state, bool sigma_s_free,
                                            bool settled);

/// The problem of some stops alone, those of a place together, with all landmarks; measured distances between landmarks belong to
/// no stop.
JointProblem part_of(const JointProblem& problem, const std::vector<int>& stops);

/// The problem with all stops and without the readings and measured distances of some landmarks, which stay in it unread.
JointProblem without_landmarks(const JointProblem& problem, const std::vector<char>& left_out);

}  // namespace rangecal
