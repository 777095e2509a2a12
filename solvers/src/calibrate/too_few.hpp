// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Why the problem's readings cannot tell a curve of that order and its landmarks, in words: fewer than three
/// places to stand, or fewer cells than unknowns. None where they may.
std::optional<std::string> why_too_few(const JointProblem& problem, int order);

}  // namespace rangecal
