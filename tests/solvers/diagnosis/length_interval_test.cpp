// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/length_interval.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <boost/math/distributions/non_central_chi_squared.hpp>
#include <cmath>

#include "rangecal/core/random.hpp"

namespace rangecal::diagnosis {
namespace {

/// P(chi^2_2(lambda) <= x): a second program's.
double boost_below(double x, double lambda) {
  return lambda > 0.0 ? boost::math::cdf(boost::math::non_central_chi_squared(2.0, lambda), x)
                      : 1.0 - std::exp(-0.5 * x);
}

TEST(LengthInterval, OfARoundLawIsThatOfTheNoncentralChiSquare) {
  const double s = 0.3;
  const Eigen::Matrix2d C = s * s * Eigen::Matrix2d::Identity();
  for (double R : {0.2, 0.7, 1.5, 6.0, 30.0})
    for (double r : {0.0, 0.4, 1.4, 6.3, 29.0})  // Simpson's rule over 400 panels
      EXPECT_NEAR(probability_within(R * s, {0.6 * r * s, -0.8 * r * s}, C), boost_below(R * R, r * r), 1e-7)
          << R << " " << r;
  // At R = 4 s: P(chi^2_2(l) >= 16) = 2.5 % and P(chi^2_2(h) <= 16) = 2.5 %.
  const Limits limits = length_interval({0.0, 4.0 * s}, C);
  EXPECT_NEAR(1.0 - boost_below(16.0, std::pow(limits.low / s, 2)), 0.025, 1e-5);
  EXPECT_NEAR(boost_below(16.0, std::pow(limits.high / s, 2)), 0.025, 1e-5);
  // 1 - exp(-R^2 / 2) = 97.5 % at R = 2.716: below, 0 cannot be told from the length.
  EXPECT_EQ(length_interval({2.71 * s, 0.0}, C).low, 0.0);
  EXPECT_GT(length_interval({2.72 * s, 0.0}, C).low, 0.0);
}

TEST(LengthInterval, FarFromZeroItIsTheNormalOne) {
  // At 40 standard deviations along x: R +- 1.96 s_x, but for (s_y^2 / R) / 2.
  const Eigen::Matrix2d C = Eigen::Vector2d(1.0, 4.0).asDiagonal();
  const Limits limits = length_interval({40.0, 0.0}, C);
  EXPECT_NEAR(limits.low, 40.0 - 1.96, 0.1);
  EXPECT_NEAR(limits.high, 40.0 + 1.96, 0.1);
}

TEST(LengthInterval, CoversALengthNearZeroAndAnyOther) {
  Eigen::Matrix2d C;
  C << 1.0, 0.5, 0.5, 0.6;  // axes 1.16 and 0.51
  const Eigen::Matrix2d root = C.llt().matrixL();
  const int draws = 2000;
  Random random(seed_from("CoversALengthNearZeroAndAnyOther", {}));
  for (double r : {0.0, 0.3, 1.0, 2.0, 4.0, 8.0}) {
    int covered = 0;
    for (int i = 0; i < draws; ++i) {
      const double angle = random.uniform(-3.1416, 3.1416), a = random.normal(), b = random.normal();
      const Eigen::Vector2d x =
          Eigen::Vector2d(r * std::cos(angle), r * std::sin(angle)) + root * Eigen::Vector2d(a, b);
      const Limits limits = length_interval(x, C);
      covered += limits.low <= r && r <= limits.high;
    }
    // 95 % +- 3 standard deviations of 2000 draws, sqrt(0.95 0.05 / 2000) = 0.5 %; 97.5 % at 0, and up to
    // there beside it.
    const double share = static_cast<double>(covered) / draws;
    EXPECT_GT(share, 0.935) << r;
    EXPECT_LT(share, r < 2.0 ? 0.986 : 0.965) << r;
  }
}

}  // namespace
}  // namespace rangecal::diagnosis
