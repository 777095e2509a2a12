// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/problems/landmarks/joint_nll.hpp"

namespace rangecal {

/// How much of each row's own error the pose of its stop takes up: with g the gradient of the number read in (x, y, heading),
/// P the prior covariance of the pose (along a random walk half that of a step, which ties it to both neighbours) and
/// M = sum over the stop's rows of g g^T / s^2,
///
///   h = g^T P (1 + M P)^-1 g / s^2,   z / sqrt(1 - h) of unit spread   (Cook and Weisberg 1982, ch. 2),
///
/// landmarks, curve and sigmas taken as known. Without it, rows that a pose follows more and rows that it follows less look
/// like a tail.
struct PoseLeverage {
  std::vector<double> range, bearing;  ///< h of each row, between 0 and 1
};
PoseLeverage pose_leverage(const JointProblem& rows, const JointState& state);

}  // namespace rangecal
