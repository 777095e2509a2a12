// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <Eigen/Jacobi>

namespace rangecal {

/// `rows` has one row more than columns: rotates its last row into the upper triangle above it by Givens
/// rotations.
template <typename Matrix>
void take_last_row(Matrix& rows) {
  const Eigen::Index size = rows.cols(), last = rows.rows() - 1;
  for (Eigen::Index j = 0; j < size; ++j) {
    Eigen::JacobiRotation<double> rotation;
    rotation.makeGivens(rows(j, j), rows(last, j), &rows(j, j));
    rows(last, j) = 0.0;
    for (Eigen::Index k = j + 1; k < size; ++k) {
      const double above = rows(j, k), below = rows(last, k);
      rows(j, k) = rotation.c() * above - rotation.s() * below;
      rows(last, k) = rotation.s() * above + rotation.c() * below;
    }
  }
}

}  // namespace rangecal
