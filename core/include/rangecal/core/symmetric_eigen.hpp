// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace rangecal {

/// A = V diag(lambda) V^T of a symmetric A [n x n], whose lower triangle is read. Instantiated here once for
/// all who need it: a decomposition takes longer to compile than most files.
struct SymmetricEigen {
  Eigen::VectorXd values;   ///< lambda, ascending [n]
  Eigen::MatrixXd vectors;  ///< V, orthonormal columns [n x n]
};
SymmetricEigen symmetric_eigen(const Eigen::MatrixXd& A);

/// lambda, ascending [n], of A v = lambda B v with A symmetric and B symmetric positive definite [n x n].
Eigen::VectorXd symmetric_eigenvalues(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

}  // namespace rangecal
