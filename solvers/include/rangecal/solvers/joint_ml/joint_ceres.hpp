// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {

/// `full` by Ceres: the same optimum and the same outcomes as solve_joint_block.
///
/// Residual blocks: one per cell (CellResidual: the log-determinant as two residuals, above a floor of 1/2 below log s and up to that floor,
/// so that the sum of squares equals the likelihood and J^T J is the Fisher information in expectation), one per stop with a prior, one for
/// what depends on sigma_theta alone, one per link of a random walk and per taped distance. Analytic Jacobians; alpha in a basis whitened over the seed's
/// distances, in one block with the sigmas; sparse normal equations, stops eliminated first. Gauss-Newton's
/// matrix has the Fisher information as its expectation, so Ceres's trust region does Fisher scoring. Ceres
/// logs nothing. Cost: linear in the cells per iteration; 8 to 20 iterations.
JointFit solve_joint_ceres(const JointProblem& problem, const JointState& start,
                           const JointOptions& options = {});

}  // namespace rangecal
