// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {

/// `full` by Ceres: the same optimum and the same outcomes as solve_joint_block.
///
/// One residual block per cell (CellResidual: the log-determinant as a residual above a floor that is set
/// anew, s_floor = s e^(-1/2), at each evaluation, with a level that keeps the sum of squares the
/// likelihood's), one per stop with a prior, one for what depends on sigma_theta alone, one per link of a
/// random walk and per taped distance. Analytic Jacobians; alpha in a basis whitened over the seed's
/// distances, in one block with the sigmas; sparse normal equations, stops eliminated first. Gauss-Newton's
/// matrix has the Fisher information as its expectation, so Ceres's trust region does Fisher scoring. Ceres
/// logs nothing. Cost: linear in the cells per iteration; 8 to 20 iterations.
JointFit solve_joint_ceres(const JointProblem& problem, const JointState& start,
                           const JointOptions& options = {});

}  // namespace rangecal
