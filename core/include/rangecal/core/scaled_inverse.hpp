// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

namespace rangecal {

/// A^-1 = S (S A S)^-1 S of a symmetric positive definite A [n x n], S = diag(A)^(-1/2): the matrix factored
/// (Cholesky, lower triangle) has a unit diagonal, so unknowns of any units lose no digits to each other.
/// None where A is not positive definite, or A or its inverse is not finite. Cost: n^3.
std::optional<Eigen::MatrixXd> scaled_inverse(const Eigen::MatrixXd& A);

/// Its parts, dimensionless but for S. A diagonal entry of C is how many times a variance grows by what is not known of
/// the other unknowns: rounding takes over as it nears 1e16.
struct UnitDiagonalInverse {
  Eigen::VectorXd scale;    ///< diagonal of S [n]
  Eigen::MatrixXd inverse;  ///< C = (S A S)^-1 [n x n]
};
/// None as above.
std::optional<UnitDiagonalInverse> unit_diagonal_inverse(const Eigen::MatrixXd& A);

}  // namespace rangecal
