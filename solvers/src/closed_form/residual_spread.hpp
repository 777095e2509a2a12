// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "closed_form/moments.hpp"
#include "closed_form/range_model.hpp"

namespace rangecal {

/// Standard deviation [unit of x] of the moment estimate x of the noise (variance_from_moments) about a curve that was
/// fitted to the same cells, whatever its weights. With e the errors of the cell means,
///   e ~ N(0, Omega),   Omega_ij = [i = j] x scale_i + f'_i f'_j (sqrt(v_i v_j) u_i . u_j [one stop] + u_i^T C_l u_j [one
///   landmark]),
/// x scale_i = s^2 / R the noise of the mean, v the stop's variance, C_l the landmark's covariance, u the line of sight; the
/// curve's coefficients alpha = G^T y, G = W H (H^T W H)^-1, H = (1, d, .., d^n), leave the residuals r = M e, M = I - H G^T.
/// The sum of moments.hpp, S(x) = sum r_i^2 / V_i + within / x with V_i = Omega_ii, is a quadratic form in Gaussian errors:
///   Var S = 2 tr(T T) + 2 dof_within,   T = V^-1 M Omega M^T,
///   -E dS/dx = sum T_ii scale_i / V_i + dof_within / x,   std(x) = sqrt(Var S) / (-E dS/dx).
/// T is the identity less n + 1 dimensions only where cells are independent and W = V^-1. Weights that are not the variances'
/// inverse (2021 eq. 28 has R, under noise of f^2) leave the curve's error in all precise cells at once, and a landmark's error is
/// in all its cells: both correlate residuals, and leaving them out states 2 to 9 % too little.
///
/// First order, x and curve of the estimate in Omega. Not in it: that a step of a walk or a shared place moves several stops, that
/// the landmarks' errors come from the same stops, and what alpha does to f in the noise law (of the order of s / f).
///
/// `gain`: G, one row per sample. `landmark_covariance`: by landmark, empty where distances are known. Omega is diagonal but for
/// two columns per stop and landmark, so that no cells x cells matrix is needed; cells of one stop see different landmarks. Cost:
/// linear in the samples.
double residual_spread(const std::vector<RangeSample>& samples,
                       const std::vector<Eigen::Matrix2d>& landmark_covariance, const Eigen::VectorXd& alpha,
                       const Eigen::MatrixXd& gain, const std::vector<MomentTerm>& terms, double dof_within,
                       double x);

}  // namespace rangecal
