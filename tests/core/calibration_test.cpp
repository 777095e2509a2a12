// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration.hpp"

#include <gtest/gtest.h>

namespace rangecal {
namespace {

TEST(CurveCovariance, IsThatWithTheChoiceWhereThereIsOne) {
  Calibration c;
  EXPECT_FALSE(curve_covariance(c));
  EXPECT_FALSE(curve_variance(c, 2.0));
  c.alpha_covariance = Eigen::Matrix2d{{1e-4, -2e-5}, {-2e-5, 4e-4}};
  EXPECT_EQ(&curve_covariance(c), &c.alpha_covariance);
  EXPECT_NEAR(*curve_variance(c, 2.0), 1e-4 - 2.0 * 2.0 * 2e-5 + 4.0 * 4e-4, 1e-18);
  c.covariance_with_choice = Eigen::Vector3d(1e-4, 4e-4, 9e-4).asDiagonal();
  EXPECT_EQ(&curve_covariance(c), &c.covariance_with_choice);
  EXPECT_NEAR(*curve_variance(c, 2.0), 1e-4 + 4.0 * 4e-4 + 16.0 * 9e-4, 1e-17);
}

}  // namespace
}  // namespace rangecal
