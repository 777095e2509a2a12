// SPDX-License-Identifier: BSD-3-Clause
#include "recursive/landmark_sums.hpp"

#include <gtest/gtest.h>

#include <functional>

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

/// Sums of one unknown phi with value v over the logarithms of the sigmas, slope 0.3 and curvature 2: phi is at its best
/// at -0.15, which takes 0.3^2 / (2 * 2) = 0.0225 off v.
LandmarkSums sums_of(const std::function<double(double, double)>& v) {
  LandmarkSums sums;
  sums.reference = VectorXd::Zero(1);
  sums.value.resize(SigmaGrid::nodes);
  for (int q = 0; q < SigmaGrid::nodes; ++q) {
    const Vector2d at = sums.grid.node(q);
    sums.value[q] = v(at.x(), at.y());
    sums.gradient.push_back(VectorXd::Constant(1, 0.3));
    sums.hessian.push_back(MatrixXd::Constant(1, 1, 2.0));
  }
  sums.beyond = MatrixXd::Zero(1, 1);
  return sums;
}

SumsFit fit_of(const std::function<double(double, double)>& v, const Vector2d& start) {
  return minimise_sums(sums_of(v), 1, 0, start);
}

TEST(MinimiseSums, SettlesAtTheOptimum) {
  const auto bowl = [](double x, double y) {
    const double a = x - 0.1, b = y + 0.05;
    return 300.0 * a * a + 200.0 * b * b + 50.0 * a * b;
  };
  for (const Vector2d& start : {Vector2d(0.0, 0.0), Vector2d(-0.4, 0.4), Vector2d(0.1, -0.05)}) {
    const SumsFit fit = fit_of(bowl, start);
    ASSERT_TRUE(fit.ok);
    EXPECT_TRUE(fit.settled);
    EXPECT_FALSE(fit.at_edge);
    EXPECT_LT(fit.to_gain, 1e-10);
    EXPECT_LT((fit.log_sigmas - Vector2d(0.1, -0.05)).norm(), 1e-6);
    EXPECT_NEAR(fit.phi[0], -0.15, 1e-12);
    EXPECT_NEAR(fit.nll, -0.0225, 1e-9);
  }
}

TEST(MinimiseSums, SettlesAtTheRoundingOfLargeSums) {
  // 1e9 nats are rounded to 1e-7: no step can be seen to gain any more, and nothing is left to gain.
  const auto large = [](double x, double y) { return 1e9 + 1e5 * (x * x + y * y); };
  const SumsFit fit = fit_of(large, Vector2d(0.1, 0.2));
  ASSERT_TRUE(fit.ok);
  EXPECT_TRUE(fit.settled) << fit.to_gain;
  EXPECT_LT(fit.log_sigmas.norm(), 1e-4);  // 1e5 * 1e-8 = 1e-3 nats at most; one standard deviation is 2e-3
}

TEST(MinimiseSums, SettlesAtTheEndOfTheGridAndWhereNothingDependsOnASigma) {
  const auto drawn_out = [](double x, double y) { return -5.0 * x + 100.0 * y * y; };
  const SumsFit edge = fit_of(drawn_out, Vector2d(0.0, 0.1));
  ASSERT_TRUE(edge.ok);
  EXPECT_TRUE(edge.settled) << edge.to_gain;
  EXPECT_TRUE(edge.at_edge);
  EXPECT_NEAR(edge.log_sigmas.x(), 0.4, 1e-9);
  EXPECT_NEAR(edge.log_sigmas.y(), 0.0, 1e-6);
  const auto flat = [](double, double y) { return 1000.0 + 100.0 * y * y; };
  const SumsFit whatever = fit_of(flat, Vector2d(0.05, 0.1));
  ASSERT_TRUE(whatever.ok);
  EXPECT_TRUE(whatever.settled) << whatever.to_gain;
  EXPECT_NEAR(whatever.log_sigmas.y(), 0.0, 1e-4);  // 100 * 1e-8 nats, the limit
}

TEST(MinimiseSums, SaysWhereItStoppedShortOfAnOptimum) {
  // On a saddle there is no slope to go by: w = 0.8 across the grid and curvature -2 leave 2 * 0.8^2 / 2 = 0.64 nats.
  const SumsFit saddle = fit_of([](double x, double y) { return x * x - y * y; }, Vector2d::Zero());
  ASSERT_TRUE(saddle.ok);
  EXPECT_FALSE(saddle.settled);
  EXPECT_NEAR(saddle.to_gain, 0.64, 1e-6);
  // In a gorge y = 2 x^2, whose bottom falls by one nat per unit of x, the differences over 1e-3 see walls all around:
  // 1e9 (2 * 1e-6)^2 = 4e-3 nats, a curvature of 8e3. Its steps are far too short, and soon lead up a wall.
  const auto gorge = [](double x, double y) { return 1e9 * (y - 2.0 * x * x) * (y - 2.0 * x * x) - x; };
  const SumsFit stopped = fit_of(gorge, Vector2d::Zero());
  ASSERT_TRUE(stopped.ok);
  EXPECT_LT(stopped.log_sigmas.x(), 0.1);
  EXPECT_FALSE(stopped.settled);
  EXPECT_GT(stopped.to_gain, 1e-5);
}

}  // namespace
}  // namespace rangecal
