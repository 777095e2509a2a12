// SPDX-License-Identifier: BSD-3-Clause
#include "robust/residual_shape.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

/// N(0, 1), a share of them wrong by `wrong(random)`.
template <typename Wrong>
ChannelResiduals drawn(const char* name, int count, double share, const Wrong& wrong) {
  Random random(seed_from(name));
  ChannelResiduals residuals;
  for (int i = 0; i < count; ++i) {
    double z = random.normal();
    if (random.uniform() < share) z = wrong(random, z);
    residuals.z.push_back(z);
    residuals.s.push_back(0.02);
  }
  return residuals;
}

/// The objective of fit_residual_shape with nothing fitted and no location, by its formula.
double objective(const ChannelResiduals& residuals, const ResidualShape& at) {
  double sum = static_cast<double>(residuals.z.size()) * std::log(at.scale);
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    sum -= log_density(at.shape, residuals.z[i] / at.scale, at.scale * residuals.s[i]).value;
  return sum;
}

TEST(ResidualShape, IsAMinimumOfItsLikelihood) {
  const auto late = [](Random& random, double z) { return z - 10.0 * std::log(1.0 - random.uniform()); };
  const ChannelResiduals residuals = drawn("late", 1500, 0.08, late);
  for (const NoiseShape shape : {NoiseShape::student_t, NoiseShape::contaminated, NoiseShape::one_sided}) {
    SCOPED_TRACE(to_string(shape));
    const ResidualShape best = fit_residual_shape(residuals, first_residual_shape(residuals, shape));
    EXPECT_NEAR(best.nll, objective(residuals, best), 1e-9 * std::abs(best.nll));
    // A step of 2 % of any parameter leads uphill: of 1500 readings by 0.03 nats and more.
    for (const double factor : {0.98, 1.02}) {
      for (const auto member : {&NoiseShapeParameters::nu, &NoiseShapeParameters::outlier_share,
                                &NoiseShapeParameters::outlier_scale, &NoiseShapeParameters::outlier_mean}) {
        ResidualShape moved = best;
        moved.shape.*member *= factor;
        EXPECT_GE(objective(residuals, moved), best.nll - 1e-6);
      }
      ResidualShape moved = best;
      moved.scale *= factor;
      EXPECT_GT(objective(residuals, moved), best.nll + 0.01);
    }
  }
}

TEST(ResidualShape, FindsTheEchoesThatWereDrawn) {
  // Share 0.08 of 4000: binomial standard deviation 0.0043; mean of 320 exponentials of 0.2 m: 0.011 m.
  const auto late = [](Random& random, double z) { return z - 10.0 * std::log(1.0 - random.uniform()); };
  const ChannelResiduals residuals = drawn("echoes", 4000, 0.08, late);
  const RankedShapes ranked = rank_shapes(residuals, range_shapes());
  EXPECT_EQ(ranked.front().first.shape.shape, NoiseShape::one_sided);
  EXPECT_NEAR(ranked.front().first.shape.outlier_share, 0.08, 4.0 * 0.0043);
  EXPECT_NEAR(ranked.front().first.shape.outlier_mean, 0.2, 4.0 * 0.011);
  // The other way round they are early.
  ChannelResiduals early = residuals;
  for (double& z : early.z) z = -z;
  const RankedShapes mirrored = rank_shapes(early, range_shapes());
  EXPECT_EQ(mirrored.front().first.shape.shape, NoiseShape::one_sided);
  EXPECT_NEAR(mirrored.front().first.shape.outlier_mean, -ranked.front().first.shape.outlier_mean, 1e-6);
}

TEST(ResidualShape, OneGrossOutlierIsAShareOfOneInN) {
  // The outer product of the scores is nothing there: a single reading holds share and size.
  ChannelResiduals residuals = drawn("gross", 500, 0.0, [](Random&, double z) { return z; });
  residuals.z[17] = 80.0;
  const ResidualShape best =
      fit_residual_shape(residuals, first_residual_shape(residuals, NoiseShape::contaminated));
  // p = 1 / 500 but for what the core cannot rule out: a wide component holds a small part of every reading.
  EXPECT_NEAR(best.shape.outlier_share, 0.002, 0.0005);
  EXPECT_NEAR(best.shape.outlier_scale * best.scale, 80.0, 5.0);
  EXPECT_TRUE(may_have_outliers(residuals));
}

TEST(ResidualShape, CleanResidualsAreMostlyGaussian) {
  // A screen that passes a third of clean channels, and AIC that keeps the Gaussian in most of those: of 200 channels
  // AIC takes a tail with probability 0.16 or less at its one boundary parameter: 32 + 4 binomial deviations of 5.2.
  int passed = 0, taken = 0;
  for (std::uint64_t repeat = 0; repeat < 200; ++repeat) {
    Random random(seed_from("clean residuals", {repeat}));
    ChannelResiduals residuals;
    for (int i = 0; i < 200; ++i) {
      residuals.z.push_back(random.normal());
      residuals.s.push_back(0.02);
    }
    if (!may_have_outliers(residuals)) continue;
    ++passed;
    taken += rank_shapes(residuals, range_shapes()).front().first.shape.shape != NoiseShape::gaussian;
  }
  EXPECT_LT(passed, 100);
  EXPECT_LE(taken, 53);
}

}  // namespace
}  // namespace rangecal
