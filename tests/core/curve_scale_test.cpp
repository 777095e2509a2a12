// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/curve_scale.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

constexpr CurveScale quarter{CurveFamily::reciprocal, 0.25, {}};

TEST(CurveScale, OfADistanceIsTheDistance) {
  const CurveScale scale;
  EXPECT_EQ(scale.of(1.7), 1.7);
  EXPECT_EQ(scale.slope(1.7), 1.0);
  EXPECT_EQ(scale.curvature(1.7), 0.0);
  EXPECT_EQ(scale.distance(1.7), 1.7);
}

// By hand: d + c = 2, u = 1/2, u' = -1/4, u'' = 2/8.
TEST(CurveScale, ReciprocalByHand) {
  EXPECT_DOUBLE_EQ(quarter.of(1.75), 0.5);
  EXPECT_DOUBLE_EQ(quarter.slope(1.75), -0.25);
  EXPECT_DOUBLE_EQ(quarter.curvature(1.75), 0.25);
  EXPECT_DOUBLE_EQ(quarter.distance(0.5), 1.75);
}

TEST(CurveScale, NamesGoBothWays) {
  for (const CurveFamily family : {CurveFamily::polynomial, CurveFamily::reciprocal})
    EXPECT_EQ(curve_family_from_string(to_string(family)), family);
  EXPECT_THROW(curve_family_from_string("hyperbola"), InputError);
}

// f = 0.2 + 3 u + 4 u^2 at u = 1/2: 2.7; f' = (3 + 8 u) u' = 7 * -1/4; var = p^T C p, p = (1, 1/2, 1/4), C = diag(1, 4, 16).
TEST(CurveScale, CalibrationReadsOnItsScale) {
  Calibration c;
  c.scale = quarter;
  c.alpha = Eigen::Vector3d(0.2, 3.0, 4.0);
  c.alpha_covariance = Eigen::Vector3d(1.0, 4.0, 16.0).asDiagonal();
  EXPECT_DOUBLE_EQ(c.f(1.75), 2.7);
  EXPECT_DOUBLE_EQ(c.slope(1.75), -1.75);
  EXPECT_DOUBLE_EQ(curve_variance(c, 1.75).value(), 3.0);
}

TEST(CurveScale, SameScalesHaveTheSameOffset) {
  EXPECT_TRUE(quarter.same_as(quarter));
  EXPECT_FALSE(quarter.same_as({CurveFamily::reciprocal, 0.3, {}}));
  EXPECT_FALSE(quarter.same_as({}));
}

TEST(CurveScale, WhatNeedsADistanceSaysSo) {
  Calibration c;
  require_polynomial(c, "--from");
  c.scale = quarter;
  EXPECT_THROW(require_polynomial(c, "--from"), InputError);
}

}  // namespace
}  // namespace rangecal
