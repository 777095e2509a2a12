// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/curve.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

Calibration line(double offset, double slope, std::optional<Eigen::Matrix2d> covariance) {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector2d(offset, slope);
  if (covariance) c.alpha_covariance = *covariance;
  c.range_min_m = 1.0;
  c.range_max_m = 5.0;
  return c;
}

const Eigen::Matrix2d diagonal = Eigen::Vector2d(1e-4, 4e-6).asDiagonal();  // std 0.01 m and 0.002

TEST(Curve, PointWithItsDeviation) {
  Calibration c = line(0.1, 0.9, diagonal);
  c.noise.law = NoiseLaw::f;
  c.noise.parameters = Eigen::VectorXd::Constant(1, 0.05);
  const CurvePoint point = *curve_point(c, 2.0);
  EXPECT_NEAR(point.reading_m, 1.9, 1e-15);                            // 0.1 + 0.9 * 2
  EXPECT_NEAR(*point.std_dev_m, std::sqrt(1e-4 + 4.0 * 4e-6), 1e-15);  // (1, 2) C (1, 2)^T
  EXPECT_NEAR(point.noise_m, 0.095, 1e-15);
  EXPECT_EQ(curve_points(c).size(), 5u);
  EXPECT_FALSE(curve_point(Calibration{}, 1.0));
}

TEST(CurveChange, OffsetOfThreeDeviations) {
  // delta = (0.03, 0); C = diag(2e-4, 8e-6); chi^2 = 9e-4 / 2e-4 = 4.5 with 2 degrees of freedom: p =
  // exp(-2.25).
  const CurveChange change = compare_curves(line(0.1, 0.9, diagonal), line(0.13, 0.9, diagonal));
  EXPECT_NEAR(change.largest_m, 0.03, 1e-12);
  EXPECT_NEAR(change.rms_m, 0.03, 1e-12);
  ASSERT_EQ(change.at.size(), 5u);
  EXPECT_NEAR(change.at[2].change_m, 0.03, 1e-12);
  EXPECT_NEAR(*change.at[2].std_dev_m, std::sqrt(2e-4 + 9.0 * 8e-6), 1e-12);  // at 3 m
  EXPECT_EQ(change.degrees_of_freedom, 2);
  EXPECT_NEAR(*change.chi_sq, 4.5, 1e-9);
  EXPECT_NEAR(*change.p_value, std::exp(-2.25), 1e-9);
  EXPECT_FALSE(change.first_taken_as_exact);
}

TEST(CurveChange, WithoutUncertaintyBeforeItIsTakenAsExact) {
  const CurveChange change = compare_curves(line(0.1, 0.9, std::nullopt), line(0.13, 0.9, diagonal));
  EXPECT_TRUE(change.first_taken_as_exact);
  EXPECT_NEAR(*change.chi_sq, 9.0, 1e-9);
  EXPECT_FALSE(compare_curves(line(0.1, 0.9, diagonal), line(0.1, 0.9, std::nullopt)).p_value);
}

TEST(CurveChange, OrdersMayDiffer) {
  Calibration after = line(0.1, 0.9, std::nullopt);
  after.alpha = Eigen::Vector3d(0.1, 0.9, 0.01);
  after.alpha_covariance = Eigen::Matrix3d(Eigen::Vector3d(1e-4, 4e-6, 1e-6).asDiagonal());
  const CurveChange change = compare_curves(line(0.1, 0.9, diagonal), after);
  EXPECT_NEAR(change.largest_m, 0.25, 1e-12);  // 0.01 * 5^2
  EXPECT_EQ(change.degrees_of_freedom, 3);
  EXPECT_NEAR(*change.chi_sq, 100.0, 1e-6);  // (0.01 / 0.001)^2
  EXPECT_THROW(compare_curves(Calibration{}, after), InputError);
  EXPECT_THROW(compare_curves(after, Calibration{}), InputError);
}

}  // namespace
}  // namespace rangecal
