// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/scaled_inverse.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace rangecal {
namespace {

TEST(ScaledInverse, OfTwoByTwoIsWorkedByHand) {
  // [4 2; 2 9]: determinant 32, inverse [9 -2; -2 4] / 32.
  const auto inverse = scaled_inverse(Eigen::MatrixXd{{4.0, 2.0}, {2.0, 9.0}});
  ASSERT_TRUE(inverse);
  EXPECT_TRUE(inverse->isApprox(Eigen::MatrixXd{{9.0, -2.0}, {-2.0, 4.0}} / 32.0, 1e-15));
}

TEST(ScaledInverse, LosesNothingToUnitsTwentyFourDecadesApart) {
  // Correlations rho^|i - j| between unknowns of variance 10^(-12 .. 12). The inverse of [rho^|i - j|] is
  // tridiagonal: (1 + rho^2) / (1 - rho^2) on the diagonal, 1 / (1 - rho^2) at its ends, -rho / (1 - rho^2) beside it.
  constexpr int n = 9;
  constexpr double rho = 0.8, c = 1.0 / (1.0 - rho * rho);
  Eigen::MatrixXd A(n, n), expected = Eigen::MatrixXd::Zero(n, n);
  const auto unit = [](int i) { return std::pow(10.0, 0.5 * (-12.0 + 3.0 * i)); };
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      A(i, j) = unit(i) * unit(j) * std::pow(rho, std::abs(i - j));
      if (i == j) expected(i, j) = i == 0 || i == n - 1 ? c : c * (1.0 + rho * rho);
      if (std::abs(i - j) == 1) expected(i, j) = -rho * c;
    }
  EXPECT_DOUBLE_EQ(A(0, 0), 1e-12);
  EXPECT_DOUBLE_EQ(A(n - 1, n - 1), 1e12);
  const auto inverse = scaled_inverse(A);
  ASSERT_TRUE(inverse);
  // The correlations have the condition ((1 + rho) / (1 - rho))^2 = 81 at most: about that times the rounding.
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      EXPECT_NEAR((*inverse)(i, j) * unit(i) * unit(j), expected(i, j), 1e-13) << i << ' ' << j;
}

TEST(ScaledInverse, HasAUnitDiagonalInItsParts) {
  // [4 3; 3 9] scaled: [1 1/2; 1/2 1], inverse [4 -2; -2 4] / 3.
  const auto parts = unit_diagonal_inverse(Eigen::MatrixXd{{4.0, 3.0}, {3.0, 9.0}});
  ASSERT_TRUE(parts);
  EXPECT_TRUE(parts->scale.isApprox(Eigen::Vector2d(1.0 / 2.0, 1.0 / 3.0), 1e-15));
  EXPECT_TRUE(parts->inverse.isApprox(Eigen::MatrixXd{{4.0, -2.0}, {-2.0, 4.0}} / 3.0, 1e-15));
  EXPECT_FALSE(unit_diagonal_inverse(Eigen::MatrixXd{{1.0, 2.0}, {2.0, 1.0}}));
}

TEST(ScaledInverse, IsNoneWhereNotPositiveDefinite) {
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, 2.0}, {2.0, 1.0}}));
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, 0.0}, {0.0, 0.0}}));
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, 0.0}, {0.0, -1.0}}));
}

TEST(ScaledInverse, IsNoneWhereNotFinite) {
  constexpr double none = std::numeric_limits<double>::quiet_NaN(),
                   infinite = std::numeric_limits<double>::infinity();
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, none}, {none, 1.0}}));
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, 0.0}, {0.0, none}}));
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, infinite}, {infinite, 1.0}}));
  EXPECT_FALSE(scaled_inverse(Eigen::MatrixXd{{1.0, 0.5}, {0.5, infinite}}));
}

}  // namespace
}  // namespace rangecal
