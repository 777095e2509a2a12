// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/joint_ml/robust.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;

/// One reading in ten says 30 standard deviations too much (an echo), one bearing in ten is off by 10 of its own.
testing::JointScene with_outliers(std::uint64_t repeat) {
  testing::JointScene scene =
      make_scene("outliers", {.stops = 16, .landmarks = 40, .law = NoiseLaw::f, .sigma_e = 0.02}, repeat);
  Random random(seed_from("outlier draws", {repeat}));
  Cells& c = scene.problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (random.uniform(0, 1) < 0.1) c.range_mean[i] += 30.0 * 0.02 * c.range_mean[i];
    if (random.uniform(0, 1) < 0.1) c.bearing_mean[i] += random.normal(0, 10.0 * 0.0087);
  }
  return scene;
}

/// Error of f at 2 m in standard deviations of the fit.
double curve_error(const JointFit& fit, const testing::JointScene& scene) {
  const Eigen::Vector3d row(1.0, 2.0, 4.0);
  const double error = row.dot(fit.state.alpha - scene.truth.alpha);
  return error / std::sqrt(row.dot(fit.covariance->topLeftCorner<3, 3>() * row));
}

TEST(Robust, KeepsTheCurveWhereOneReadingInTenIsWrong) {
  for (std::uint64_t repeat = 0; repeat < 2; ++repeat) {
    const testing::JointScene scene = with_outliers(repeat);
    const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f);
    const RobustMarginalFit gaussian = solve_marginal_robust(scene.problem, seed, NoiseShape::gaussian);
    ASSERT_EQ(gaussian.fit.outcome, Outcome::converged) << gaussian.fit.reason;
    EXPECT_GT(std::abs(curve_error(gaussian.fit, scene)), 3.0);
    for (NoiseShape shape : {NoiseShape::student_t, NoiseShape::contaminated, NoiseShape::automatic}) {
      const RobustMarginalFit marginal = solve_marginal_robust(scene.problem, seed, shape);
      ASSERT_EQ(marginal.fit.outcome, Outcome::converged) << marginal.fit.reason;
      EXPECT_LT(std::abs(curve_error(marginal.fit, scene)), 3.0) << to_string(shape);
      const RobustJointFit full = solve_joint_robust(scene.problem, seed, shape);
      ASSERT_EQ(full.fit.outcome, Outcome::converged) << full.fit.reason;
      EXPECT_LT(std::abs(curve_error(full.fit, scene)), 3.0) << to_string(shape);
      EXPECT_LT(marginal.shapes.aic, gaussian.shapes.aic);
      EXPECT_NE(marginal.shapes.range.shape, NoiseShape::gaussian);
    }
  }
}

TEST(Robust, ContaminatedFindsTheShareOfOutliers) {
  const testing::JointScene scene = with_outliers(1);
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f);
  const RobustMarginalFit fit = solve_marginal_robust(scene.problem, seed, NoiseShape::contaminated);
  // About 640 readings, share 0.1: binomial standard deviation 0.012.
  EXPECT_NEAR(fit.shapes.range.outlier_share, 0.1, 0.036);
  EXPECT_GT(fit.shapes.range.outlier_scale, 6.0);
}

TEST(Robust, AutomaticKeepsTheGaussianWhereNothingIsWrong) {
  const testing::JointScene scene =
      make_scene("clean", {.stops = 30, .landmarks = 5, .law = NoiseLaw::f, .sigma_e = 0.02});
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f);
  const RobustJointFit fit = solve_joint_robust(scene.problem, seed, NoiseShape::automatic);
  EXPECT_EQ(fit.shapes.tried.size(), 3u);
  EXPECT_EQ(fit.shapes.range.shape, NoiseShape::gaussian);
  const JointFit plain = solve_joint_block(scene.problem, seed);
  EXPECT_NEAR(fit.shapes.nll, plain.joint_nll, 1e-8);
}

TEST(Robust, LikelihoodsAtAStateAreThoseThatWereMinimised) {
  const testing::JointScene scene = with_outliers(0);
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f);
  const RobustMarginalFit marginal = solve_marginal_robust(scene.problem, seed, NoiseShape::student_t);
  const RobustNll at =
      robust_nll(scene.problem, marginal.fit.state, marginal.shapes.range, marginal.shapes.bearing);
  ASSERT_TRUE(at.ok);
  // The weights of the last round are those of the round before: they differ by less than the last gain's root.
  EXPECT_NEAR(at.marginal, marginal.shapes.nll, 1e-2);
  const RobustJointFit full = solve_joint_robust(scene.problem, seed, NoiseShape::student_t);
  const RobustNll best = robust_nll(scene.problem, full.fit.state, full.shapes.range, full.shapes.bearing);
  EXPECT_NEAR(best.joint, full.shapes.nll, 1e-9);
  EXPECT_LT(best.joint, at.joint);
}

TEST(Robust, RefusesCellsOfSeveralReadings) {
  const testing::JointScene scene = make_scene("cells", {.stops = 6, .landmarks = 4, .repeats = 3});
  EXPECT_THROW(solve_joint_robust(scene.problem, scene.truth, NoiseShape::student_t), InputError);
}

}  // namespace
}  // namespace rangecal
