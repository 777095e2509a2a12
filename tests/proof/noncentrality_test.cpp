// SPDX-License-Identifier: BSD-3-Clause
#include "proof/noncentrality.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"

namespace rangecal::proof {
namespace {

/// Two cylinders seen from three exact stops: alpha is free, the landmarks are pinned by their many bearings.
world::World small_world() {
  world::World w = world::make_line_design();
  w.robot.stated_sigma_m = w.robot.placing_sigma_m = 0.01;
  return w;
}

TEST(Noncentrality, CleanWorldsAreClean) {
  Random random(seed_from("Noncentrality.CleanWorldsAreClean"));
  for (const world::World& design : {world::make_line_design(), world::make_turning_design()})
    for (int i = 0; i < 4; ++i) EXPECT_LT(noncentrality(world::vary(design, random)), 1.0);
}

TEST(Noncentrality, WithinCellSwingByHand) {
  // A change within cells is absorbed by nothing: lambda is at least the sum of (deviation / sd)^2. The head swings by
  // A exp(-t/T); with one reading pushed up by e and one down by e in a cell of two, the deviations are +-e, so that the
  // rows' part of one cell is 2 (e / sd)^2.
  const world::World clean = small_world();
  const SeedModel model(clean);
  world::Expected target = world::expected(clean);
  const double e = 0.003;
  for (std::size_t i = 0; i < target.stop.size(); ++i)
    if (target.stop[i] == 0 && target.landmark[i] == 0 && target.repeat[i] < 2)
      target.bearing_mean_rad[i] += target.repeat[i] == 0 ? e : -e;
  const double sd = model.bearing_sd_rad(model.cell(0, 0));
  const double by_hand = 2.0 * (e / sd) * (e / sd);
  // The cell means are unchanged; 1e-3 is the noncentrality of the clean world itself.
  EXPECT_NEAR(model.fit(target).residual.squared_norm(), by_hand, 1e-3);
}

TEST(Noncentrality, ConstantRangeIsAbsorbedAndBearingOffsetOfExactHeadingsIsNot) {
  const world::World clean = small_world();
  const SeedModel model(clean);
  world::Expected target = world::expected(clean);
  for (double& range : target.range_mean_m) range += 0.01;
  EXPECT_LT(model.fit(target).residual.squared_norm(), 1e-3);
  // All bearings turned by b with exact headings: the landmarks turn about the path with it, so that stops must move
  // across their priors: by b x at x along the path, less a straight shift of the landmarks, hence a slope b. With the
  // stops' errors free the cost is at most that of turning the path about its middle: sum (b (x - mean))^2 / sigma^2.
  target = world::expected(clean);
  const double b = 0.01;
  for (double& bearing : target.bearing_mean_rad) bearing += b;
  double moment = 0.0;
  for (int k = 0; k < 20; ++k) moment += std::pow(0.15 * (k - 9.5), 2);
  const double bound = b * b * moment / (0.01 * 0.01);
  const double lambda = model.fit(target).residual.squared_norm();
  EXPECT_GT(lambda, 0.3 * bound);
  EXPECT_LE(lambda, bound * 1.0001);
}

TEST(Noncentrality, OfACleanWorldTheOracleGainsNothing) {
  const world::World clean = small_world();
  EXPECT_NEAR(oracle_nats(SeedModel(clean), clean), 0.0, 1e-6);
}

TEST(Noncentrality, OracleGainOfMeansIsHalfLambda) {
  // For a change of means alone the divergence is m^T S^-1 m / 2 and lambda the same quadratic form.
  const world::World clean = small_world();
  const SeedModel model(clean);
  Random random(seed_from("Noncentrality.OracleGain"));
  const world::World planted = world::apply(clean, "knock", 0.004, random);
  const double lambda = noncentrality(model, planted);
  // 3 %: the divergence fits the range's sigma anew, and the spread follows f^2 of the moved readings.
  EXPECT_NEAR(oracle_nats(model, planted), 0.5 * lambda, 0.03 * 0.5 * lambda);
}

TEST(Noncentrality, BurstOfNoiseByHand) {
  // AR(1) of rho: 300 cells of 15 readings lose at least (R - 1) log(1 / (1 - rho^2)) / 2 per cell between deviations.
  // rho = 0.5, 20 x 5 cells: 100 x 14 x 0.5 x log(4/3) = 201 nats; what the fitted sigma takes back is below a tenth.
  const world::World clean = small_world();
  Random random(1);
  const world::World planted = world::apply(clean, "autocorrelated_noise", 0.5, random);
  const double by_hand = 100.0 * 14.0 * 0.5 * std::log(4.0 / 3.0);
  EXPECT_NEAR(oracle_nats(SeedModel(clean), planted), by_hand, 0.1 * by_hand);
}

TEST(SizeFor, HitsItsTargetWithinTwoPercent) {
  int number = 0;
  for (const world::World& design : {world::make_line_design(), world::make_turning_design()}) {
    const SeedModel model(design);
    for (const char* id : {"range_eccentricity", "bearing_scale", "wheel_slip", "settling", "near_regime"}) {
      const auto seed = seed_from("SizeFor", {static_cast<std::uint64_t>(number++)});
      const auto sized = size_for(model, id, 100.0, Measure::lambda, seed, -1.0);
      ASSERT_TRUE(sized) << id;
      EXPECT_LT(sized->size, 0.0);
      EXPECT_NEAR(noncentrality(model, sized->planted), 100.0, 2.0) << id;
    }
    for (const char* id : {"cell_effect", "heavy_tails", "noise_law"}) {
      const auto seed = seed_from("SizeFor", {static_cast<std::uint64_t>(number++)});
      const auto sized = size_for(model, id, 50.0, Measure::nats, seed);
      ASSERT_TRUE(sized) << id;
      EXPECT_NEAR(oracle_nats(model, sized->planted), 50.0, 1.0) << id;
    }
  }
}

TEST(SizeFor, SaysWhenTheTargetIsOutOfReach) {
  const SeedModel model(world::make_line_design());
  EXPECT_FALSE(size_for(model, "lens_distortion", 30.0, Measure::lambda, 1));
  EXPECT_FALSE(size_for(model, "range_offset", 1.0, Measure::lambda, 1));
}

}  // namespace
}  // namespace rangecal::proof
