// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// The Cramer-Rao bound at `state`: inverse of the expected information of the globals (layout of JointLayout:
/// alpha, landmarks, noise, log sigma_theta), stops with their prior marginalised. None if singular.
std::optional<Eigen::MatrixXd> cramer_rao_bound(const JointProblem& problem, const JointState& state);

/// The hybrid Cramer-Rao bound: the information is averaged over `draws` draws of the stops from their prior about
/// the commanded poses before the stops are marginalised. Deterministic for a given seed.
std::optional<Eigen::MatrixXd> hybrid_cramer_rao_bound(const JointProblem& problem, const JointState& state,
                                                       int draws, std::uint64_t seed);

/// Stops drawn from their prior (independent, or a random walk in the frame of the stop before).
std::vector<Pose2> draw_stops(const JointProblem& problem, const JointState& state, std::uint64_t seed);

}  // namespace rangecal
