// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/phase_interval.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <numbers>

#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double known = std::numeric_limits<double>::infinity();

TEST(PhaseInterval, OfARoundLawIsAnArcSine) {
  // x = 5 s along 36.87 degrees, atan2(3, 4): the tangents lie asin(1.959964 / 5) = 0.402797 rad to either side.
  const auto limits = phase_interval({0.4, 0.3}, 0.01 * Eigen::Matrix2d::Identity(), known);
  ASSERT_TRUE(limits);
  EXPECT_NEAR(limits->low, 0.643501 - 0.402797, 1e-5);
  EXPECT_NEAR(limits->high, 0.643501 + 0.402797, 1e-5);
  // nu = 10: t = 2.228139, asin(2.228139 / 5) = 0.461875.
  const auto estimated = phase_interval({0.4, 0.3}, 0.01 * Eigen::Matrix2d::Identity(), 10.0);
  ASSERT_TRUE(estimated);
  EXPECT_NEAR(estimated->high, 0.643501 + 0.461875, 1e-5);
}

TEST(PhaseInterval, ItsEndsAreWhereTheOtherComponentIsJustRejected) {
  Eigen::Matrix2d C;
  C << 1.0, 0.5, 0.5, 0.6;
  const Eigen::Vector2d x(-4.0, 0.3);  // beside the cut of atan2
  const auto limits = phase_interval(x, C, known);
  ASSERT_TRUE(limits);
  for (const double phi : {limits->low, limits->high}) {
    const Eigen::Vector2d n(std::sin(phi), -std::cos(phi));
    EXPECT_NEAR(std::abs(n.dot(x)) / std::sqrt(n.dot(C * n)), z95, 1e-9);
  }
  EXPECT_LT(limits->low, std::atan2(x.y(), x.x()));
  EXPECT_GT(limits->high, std::atan2(x.y(), x.x()));
  EXPECT_LT(limits->high - limits->low, std::numbers::pi);
}

TEST(PhaseInterval, EveryDirectionWhereTheLengthIsNotToldFromZero) {
  const Eigen::Matrix2d one = Eigen::Matrix2d::Identity();
  // sqrt(-2 ln 0.05) = 2.4477; nu = 4: sqrt(4 (0.05^-0.5 - 1)) = sqrt(4 * 3.472136) = 3.7267.
  EXPECT_FALSE(phase_interval({2.44, 0.0}, one, known));
  EXPECT_TRUE(phase_interval({2.45, 0.0}, one, known));
  EXPECT_FALSE(phase_interval({3.72, 0.0}, one, 4.0));
  EXPECT_TRUE(phase_interval({3.73, 0.0}, one, 4.0));
  EXPECT_FALSE(phase_interval({1.0, 0.0}, Eigen::Matrix2d::Zero(), known));
}

TEST(PhaseInterval, CoversAtEveryLength) {
  Eigen::Matrix2d C;
  C << 1.0, 0.5, 0.5, 0.6;
  const Eigen::Matrix2d root = C.llt().matrixL();
  const int draws = 4000;
  Random random(seed_from("PhaseInterval.CoversAtEveryLength", {}));
  for (const int nu : {0, 5})  // 0: the variance is known
    for (const double r : {0.0, 0.5, 1.0, 2.0, 4.0, 10.0}) {
      int covered = 0;
      for (int i = 0; i < draws; ++i) {
        const double phi = random.uniform(-std::numbers::pi, std::numbers::pi), a = random.normal(),
                     b = random.normal();
        double sum = 0.0;
        for (int k = 0; k < nu; ++k) sum += std::pow(random.normal(), 2);
        const Eigen::Vector2d x =
            Eigen::Vector2d(r * std::cos(phi), r * std::sin(phi)) + root * Eigen::Vector2d(a, b);
        const auto limits =
            phase_interval(x, nu > 0 ? Eigen::Matrix2d(sum / nu * C) : C, nu > 0 ? nu : known);
        const double middle = limits ? 0.5 * (limits->low + limits->high) : 0.0;
        covered += !limits || std::abs(std::remainder(phi - middle, 2.0 * std::numbers::pi)) <=
                                  0.5 * (limits->high - limits->low);
      }
      // 95 % less 3 standard deviations of 4000 draws, sqrt(0.95 0.05 / 4000) = 0.34 %; more where every direction is
      // often the answer; far from 0 just that.
      const double share = static_cast<double>(covered) / draws;
      EXPECT_GT(share, 0.9397) << nu << " " << r;
      EXPECT_LT(share, r == 10.0 ? 0.9603 : 1.0 + 1e-9) << nu;
    }
}

}  // namespace
}  // namespace rangecal::diagnosis
