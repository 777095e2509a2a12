// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/curve_scale.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

const CurveScale quarter{CurveFamily::reciprocal, 0.25, {}};

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
  for (const CurveFamily family : {CurveFamily::polynomial, CurveFamily::reciprocal, CurveFamily::spline})
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

/// u at 1, 2, 4 m: 1, 2.5, 4.
CurveScale bent() {
  CurveScale scale{CurveFamily::spline, 0.0, {}};
  scale.spline.emplace();
  scale.spline->u = NaturalSpline(Eigen::Vector3d(1.0, 2.0, 4.0), Eigen::Vector3d(1.0, 2.5, 4.0));
  scale.spline->covariance = Eigen::Vector3d(0.0, 0.04, 0.0).asDiagonal();
  scale.spline->degrees = 2.75;
  return scale;
}

TEST(CurveScale, SplineGoesBothWays) {
  const CurveScale scale = bent();
  for (const double d : {0.4, 1.0, 1.3, 2.0, 3.1, 4.0, 5.5}) {
    EXPECT_NEAR(scale.distance(scale.of(d)), d, 1e-14);
    const double h = 1e-5;
    EXPECT_NEAR(scale.slope(d), (scale.of(d + h) - scale.of(d - h)) / (2.0 * h), 1e-9);
  }
  EXPECT_EQ(scale.parameters(), 0.75);
  EXPECT_TRUE(scale.same_as(bent()));
  EXPECT_FALSE(scale.same_as({}));
}

// At the knot of 2 m u has the variance 0.04 m^2; f = 0.1 + 3 u there has 9 times that, and 0.01 + 2.5^2 0.0004 by alpha.
TEST(CurveScale, SplineAddsTheVarianceOfItsShape) {
  Calibration c;
  c.scale = bent();
  c.alpha = Eigen::Vector2d(0.1, 3.0);
  c.alpha_covariance = Eigen::Vector2d(0.01, 0.0004).asDiagonal();
  EXPECT_NEAR(shape_variance(c, 2.0), 0.36, 1e-15);
  EXPECT_NEAR(curve_variance(c, 2.0).value(), 0.36 + 0.01 + 0.0025, 1e-15);
  EXPECT_NEAR(shape_variance(c, 4.0), 0.0, 1e-15);
}

TEST(CurveScale, WhatNeedsADistanceSaysSo) {
  Calibration c;
  require_polynomial(c, "--from");
  c.scale = quarter;
  EXPECT_THROW(require_polynomial(c, "--from"), InputError);
}

}  // namespace
}  // namespace rangecal
