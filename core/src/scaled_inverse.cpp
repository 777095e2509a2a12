// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/scaled_inverse.hpp"

#include <Eigen/Cholesky>

namespace rangecal {

std::optional<UnitDiagonalInverse> unit_diagonal_inverse(const Eigen::MatrixXd& A) {
  UnitDiagonalInverse result;
  result.scale = A.diagonal().cwiseSqrt().cwiseInverse();
  if (!result.scale.allFinite()) return std::nullopt;
  const Eigen::LLT<Eigen::MatrixXd> factor(result.scale.asDiagonal() * A * result.scale.asDiagonal());
  if (factor.info() != Eigen::Success) return std::nullopt;
  result.inverse = factor.solve(Eigen::MatrixXd::Identity(A.rows(), A.cols()));
  if (!result.inverse.allFinite()) return std::nullopt;  // the factor of what is not a number succeeds
  return result;
}

std::optional<Eigen::MatrixXd> scaled_inverse(const Eigen::MatrixXd& A) {
  const std::optional<UnitDiagonalInverse> unit = unit_diagonal_inverse(A);
  if (!unit) return std::nullopt;
  Eigen::MatrixXd inverse = unit->scale.asDiagonal() * unit->inverse * unit->scale.asDiagonal();
  if (!inverse.allFinite()) return std::nullopt;
  return inverse;
}

}  // namespace rangecal
