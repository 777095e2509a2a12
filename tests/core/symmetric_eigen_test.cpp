// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/symmetric_eigen.hpp"

#include <gtest/gtest.h>

namespace rangecal {
namespace {

TEST(SymmetricEigen, ReadsTheLowerTriangleAndAscends) {
  // [2 1; 1 2]: eigenvalues 1 and 3 along (1, -1) and (1, 1).
  const Eigen::MatrixXd A{{2.0, 99.0}, {1.0, 2.0}};
  const SymmetricEigen eigen = symmetric_eigen(A);
  EXPECT_NEAR(eigen.values[0], 1.0, 1e-14);
  EXPECT_NEAR(eigen.values[1], 3.0, 1e-14);
  EXPECT_NEAR(eigen.vectors.col(0).dot(Eigen::Vector2d(1.0, 1.0)), 0.0, 1e-14);
  EXPECT_TRUE((eigen.vectors.transpose() * eigen.vectors).isIdentity(1e-14));
}

TEST(SymmetricEigen, OfAPairIsThatOfTheQuotient) {
  const Eigen::MatrixXd A = Eigen::Vector3d(6.0, 2.0, 20.0).asDiagonal(),
                        B = Eigen::Vector3d(2.0, 1.0, 4.0).asDiagonal();
  EXPECT_TRUE(symmetric_eigenvalues(A, B).isApprox(Eigen::Vector3d(2.0, 3.0, 5.0), 1e-14));
}

}  // namespace
}  // namespace rangecal
