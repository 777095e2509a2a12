// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/natural_spline.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

NaturalSpline wavy() {
  return {(Eigen::VectorXd(5) << 0.3, 0.8, 1.1, 2.0, 2.2).finished(),
          (Eigen::VectorXd(5) << 0.35, 0.7, 1.3, 1.9, 2.4).finished()};
}

// Knots 0, 1, 2, values 0, 1, 0: (2/3) c = 0 - 2 + 0, c = -3. g(1/2) = 1/2 - 1/4 (3/2) (-3) / 6 = 0.6875; g'(0) = 1 + 3/6; the roughness
// is the integral of g''^2 = 2 * 9 / 3; B has that of 1 along (1, -2, 1), which is -3 times the values less their mean.
TEST(NaturalSpline, ByHand) {
  const NaturalSpline g(Eigen::Vector3d(0.0, 1.0, 2.0), Eigen::Vector3d(0.0, 1.0, 0.0));
  EXPECT_DOUBLE_EQ(g(0.5), 0.6875);
  EXPECT_DOUBLE_EQ(g(1.5), 0.6875);
  EXPECT_DOUBLE_EQ(g.curvature(1.0), -3.0);
  EXPECT_DOUBLE_EQ(g.slope(0.0), 1.5);
  EXPECT_DOUBLE_EQ(g(-1.0), -1.5);
  EXPECT_DOUBLE_EQ(g.slope(3.0), -1.5);
  EXPECT_DOUBLE_EQ(g.least_slope(), -1.5);
  const Eigen::MatrixXd B = g.bends();
  ASSERT_EQ(B.cols(), 1);
  EXPECT_NEAR((B - Eigen::Vector3d(1.0, -2.0, 1.0) / (3.0 * std::sqrt(6.0))).norm(), 0.0, 1e-14);
}

// R 4.2.2: splinefun(knots, values, method = "natural") and its two derivatives.
TEST(NaturalSpline, AgreesWithR) {
  const NaturalSpline g = wavy();
  const double at[7] = {0.1, 0.3, 0.55, 1.1, 1.6, 2.15, 2.5};
  const double value[7] = {0.313336209375899, 0.350000000000000, 0.428122303710095, 1.300000000000000,
                           1.564446787886535, 2.262669866264020, 3.228912855910266};
  const double slope[7] = {0.183318953120506, 0.183318953120506, 0.570829738280127, 1.603249928098936,
                           0.147077621193239, 2.713722318090305, 2.763042853034223};
  const double curvature[7] = {
      0.0, 0.0, 3.10008628127696, -7.06758700028760, 1.24289777266481, 1.97282139775669, 0.0};
  for (int i = 0; i < 7; ++i) {
    EXPECT_NEAR(g(at[i]), value[i], 1e-14);
    EXPECT_NEAR(g.slope(at[i]), slope[i], 1e-13);
    EXPECT_NEAR(g.curvature(at[i]), curvature[i], 1e-13);
  }
}

TEST(NaturalSpline, WeightsAreOfTheValues) {
  const NaturalSpline g = wavy();
  for (double x = -0.5; x < 3.0; x += 0.07) EXPECT_NEAR(g.weights(x).dot(g.values()), g(x), 1e-14) << x;
}

TEST(NaturalSpline, LeastSlopeIsTheLeastOfAll) {
  const NaturalSpline g = wavy();
  double least = std::numeric_limits<double>::infinity();
  for (double x = 0.0; x < 2.5; x += 1e-4) least = std::min(least, g.slope(x));
  EXPECT_NEAR(g.least_slope(), least, 1e-6);
}

TEST(NaturalSpline, InverseOfARisingOne) {
  const NaturalSpline g(Eigen::Vector4d(0.2, 0.5, 2.0, 4.0), Eigen::Vector4d(0.2, 0.9, 1.7, 4.0));
  ASSERT_GT(g.least_slope(), 0.0);
  for (double x = 0.01; x < 6.0; x += 0.013) EXPECT_NEAR(g.inverse(g(x)), x, 1e-13 * (1.0 + x));
}

TEST(NaturalSpline, RefusesWhatDeterminesNone) {
  EXPECT_THROW(NaturalSpline(Eigen::Vector2d(0.0, 1.0), Eigen::Vector2d(0.0, 1.0)), InputError);
  EXPECT_THROW(NaturalSpline(Eigen::Vector3d(0.0, 1.0, 1.0), Eigen::Vector3d(0.0, 1.0, 2.0)), InputError);
  EXPECT_THROW(NaturalSpline(Eigen::Vector3d(0.0, 1.0, 2.0), Eigen::Vector2d(0.0, 1.0)), InputError);
  EXPECT_THROW(NaturalSpline(Eigen::Vector3d(0.0, 1.0, 2.0), Eigen::Vector3d(0.0, std::nan(""), 2.0)),
               InputError);
}

}  // namespace
}  // namespace rangecal
