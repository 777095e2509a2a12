// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

namespace rangecal {

/// A start for ranges alone: the closed form (landmarks_from_ranges), and each landmark on the side of the path on which the readings
/// are likelier. Stops on a line tell no side, but stops that scatter about it do: an error of a stop across the line lengthens the ranges to
/// one side and shortens those to the other, so which landmarks stand on the same side is seen, unless stops are exact. Landmarks
/// are moved to their mirror image in the line through the stops that see them, one after the other, and stay there where the joint
/// maximum is higher, until none gains. Cost: a joint solve per landmark and pass, two passes mostly.
JointState range_seed(const JointProblem& problem, const ClosedFormOptions& options);

}  // namespace rangecal
