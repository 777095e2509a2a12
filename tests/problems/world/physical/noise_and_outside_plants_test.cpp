// SPDX-License-Identifier: BSD-3-Clause
// Departures of the random part, those outside the catalogue, and what every plant has to keep.
#include <gtest/gtest.h>

#include <boost/math/distributions/chi_squared.hpp>
#include <set>

#include "problems/world/physical/compare.hpp"
#include "rangecal/core/errors.hpp"
#include "support/catalogue.hpp"

namespace rangecal::world::test {
namespace {

/// Readings of one world minus the expected ones, in units of the expected spread.
std::vector<double> scores(const World& world, std::uint64_t seed) {
  const Recording recording = simulate(world, seed);
  const Expected out = expected(world, placing_of(world, seed));
  std::vector<double> z;
  for (std::size_t i = 0; i < out.stop.size(); ++i)
    z.push_back((recording.readings.range_m.at(i) - out.range_mean_m[i]) / out.range_sd_m[i]);
  return z;
}

TEST(NoisePlants, EachLawAtTwoMetres) {
  std::set<std::string> kinds;
  for (std::uint64_t seed = 0; seed < 12; ++seed) {
    const Change change = change_of(line(), "noise_law", 0.01, seed);
    double power = 0.0;
    for (const auto& [key, value] : change.planted.truth) kinds.insert(key);
    if (change.planted.truth.count("noise_law.cubic_per_m2")) power = 3.0;
    if (change.planted.truth.count("noise_law.quartic_per_m3")) power = 4.0;
    for (std::size_t i = 0; i < change.size(); i += 50) {
      const double extra = 0.01 * std::pow(0.5 * change.distance_m[i], power);
      EXPECT_NEAR(change.after.range_sd_m[i], std::hypot(change.before.range_sd_m[i], extra),
                  0.02 * extra + 1e-6);
    }
    EXPECT_LT(rms(change.range_m), 1e-12);
  }
  EXPECT_EQ(kinds.size(), 3u);
}

TEST(NoisePlants, DarkTargetAndStrayLight) {
  const Change dark = change_of(line(), "dark_target", 1.0);
  const Change stray = change_of(line(), "ambient_light", 0.5);
  int inside = 0;
  for (std::size_t i = 0; i < dark.size(); ++i) {
    const double wanted = dark.before.landmark[i] == dark.truth("dark_target.landmark") ? 2.0 : 1.0;
    EXPECT_NEAR(dark.after.range_sd_m[i] / dark.before.range_sd_m[i], wanted, 1e-9);
    const double off = std::abs(wrap_angle(stray.beam_rad[i] - stray.truth("ambient_light.direction_rad")));
    const bool lit = off < stray.truth("ambient_light.half_width_rad");
    inside += lit;
    EXPECT_NEAR(stray.after.range_sd_m[i] / stray.before.range_sd_m[i],
                lit ? stray.truth("ambient_light.spread_factor") : 1.0, 0.01);
  }
  EXPECT_GT(inside, 200);
  EXPECT_LT(rms(stray.range_m), 2e-3);
}

TEST(NoisePlants, SharedInACellAndSmoothedOverRepeats) {
  World world = line();
  world.timing.repeats = 50;
  Random random(1);
  const World textured = apply(world, "cell_effect", 0.03, random);
  const World smoothed = apply(world, "autocorrelated_noise", 0.6, random);
  // The mean of a cell's 50 scores has the variance (0.03 / sd)^2 + 1 / 50. Of 20 recordings of 100 cells the sum of
  // squares over variances is chi-square with 2000 degrees of freedom; each limit is passed once in 100 000.
  double squares = 0.0, cells = 0.0;
  for (std::uint64_t seed = 2; seed < 22; ++seed) {
    const std::vector<double> rough = scores(textured, seed);
    const Expected out = expected(textured, placing_of(textured, seed));
    for (std::size_t cell = 0; cell < rough.size(); cell += 50, cells += 1.0) {
      double mean = 0.0;
      for (std::size_t r = 0; r < 50; ++r) mean += rough[cell + r] / 50.0;
      squares += mean * mean / (std::pow(0.03 / out.range_sd_m[cell], 2) + 1.0 / 50.0);
    }
  }
  ASSERT_EQ(cells, 2000.0);
  const boost::math::chi_squared law(cells);
  EXPECT_GT(squares, quantile(law, 1e-5));              // 1742
  EXPECT_LT(squares, quantile(complement(law, 1e-5)));  // 2281
  const std::vector<double> smooth = scores(smoothed, 2), plain_z = scores(world, 2);
  double lagged = 0.0, variance = 0.0, plain_lagged = 0.0;
  for (std::size_t cell = 0; cell < smooth.size(); cell += 50)
    for (std::size_t r = 1; r < 50; ++r) {
      lagged += smooth[cell + r] * smooth[cell + r - 1];
      plain_lagged += plain_z[cell + r] * plain_z[cell + r - 1];
      variance += smooth[cell + r] * smooth[cell + r];
    }
  EXPECT_NEAR(lagged / variance, 0.6, 0.05);
  EXPECT_NEAR(variance / 4900.0, 1.0, 0.15);
  EXPECT_NEAR(plain_lagged / variance, 0.0, 0.07);
}

TEST(NoisePlants, InterferenceAndClippedSpotsHaveTails) {
  World world = line();
  world.timing.repeats = 100;
  Random random(1);
  const auto far_out = [](const std::vector<double>& z) {
    double count = 0.0;
    for (const double value : z) count += std::abs(value) > 4.0;
    return count / static_cast<double>(z.size());
  };
  EXPECT_LT(far_out(scores(world, 1)), 5e-4);
  // Uniform over +-10 sd: six tenths of 3 % lie beyond 4 sd.
  EXPECT_NEAR(far_out(scores(apply(world, "heavy_tails", 0.03, random), 1)), 0.018, 0.005);
  const World clipped = apply(world, "mixed_pixels", 0.005, random);
  EXPECT_GT(far_out(scores(clipped, 1)), 1e-3);
  const Expected out = expected(clipped);
  EXPECT_NEAR(out.tail_share[0], 0.005 / 0.12, 1e-12);
  // At the edge the centroid moves by w / 2 = 2.5 mm: d / s * 2.5 mm, evenly from there to the same on the other.
  EXPECT_NEAR(out.tail_high_m[0], out.distance_m[0] / 0.05 * 0.0025, 1e-12);
  EXPECT_NEAR(out.tail_low_m[0], -out.tail_high_m[0], 1e-12);
}

TEST(NoisePlants, NoiseBeforeTheReciprocalIsBiasedAndSkewed) {
  World world = line();
  world.timing.repeats = 1;
  const Change change = change_of(world, "reciprocal_noise", 0.02);
  for (std::size_t i = 0; i < change.size(); ++i) {
    const double d = change.distance_m[i], cv = 0.02 * d;  // bias cv^2 d
    if (d < 3.0) {
      EXPECT_NEAR(change.range_m[i], cv * cv * d, 0.05 * cv * cv * d);
    }
    if (d < 3.0) {
      EXPECT_NEAR(change.after.range_sd_m[i], cv * d, 0.05 * cv * d);
    }
  }
}

TEST(NoisePlants, StopsPlacedWorse) {
  Random random(1);
  const World world = apply(line(), "stop_effect", 0.02, random);
  EXPECT_NEAR(expected(world).placing_sigma_m, std::sqrt(5e-4), 1e-12);  // sqrt(1^2 + 2^2) cm
  EXPECT_EQ(simulate(world, 1).sigma_xy_m, 0.01);
}

TEST(OutsidePlants, EachHasAPlaceAndASize) {
  int outside = 0;
  for (const EffectInfo& info : effect_table()) {
    if (info.catalogued) continue;
    ++outside;
    const Change change = change_of(plain(make_turning_design()), info.id, info.typical);
    const bool range = rms(change.range_m) > 0.05 * info.typical,
               bearing = rms(change.bearing_rad) > 0.05 * info.typical;
    double spread = 0.0;
    for (std::size_t i = 0; i < change.size(); ++i)
      spread = std::max(spread, change.after.range_sd_m[i] / change.before.range_sd_m[i]);
    if (info.channels[0] == "range") {
      EXPECT_TRUE(range && !bearing) << info.id;
    }
    if (info.channels[0] == "bearing") {
      EXPECT_TRUE(bearing && !range) << info.id;
    }
    if (info.channels[0] == "range_noise") {
      EXPECT_NEAR(spread, 1.0 + info.typical, 1e-6) << info.id;
    }
  }
  EXPECT_GE(outside, 6);
}

TEST(Plants, EveryEffectChangesItsWorldAndNothingElseIsInIt) {
  for (const World& design : {make_line_design(), make_turning_design()})
    for (const EffectInfo& info : effect_table()) {
      Random random(seed_from(info.id, {1})), again(seed_from(info.id, {1}));
      const World world = apply(design, info.id, info.typical, random);
      EXPECT_EQ(world.truth, apply(design, info.id, info.typical, again).truth) << info.id;
      ASSERT_EQ(world.planted.size(), 1u);
      EXPECT_FALSE(world.truth.empty()) << info.id;
      for (const auto& [key, value] : world.truth) EXPECT_EQ(key.rfind(info.id + ".", 0), 0u) << key;
      const Recording with = simulate(world, 9), without = simulate(design, 9);
      const bool changed = with.readings.range_m != without.readings.range_m ||
                           with.readings.bearing_rad != without.readings.bearing_rad ||
                           with.readings.landmark != without.readings.landmark;
      EXPECT_TRUE(changed) << info.id << " on " << design.name;
      for (const double range : with.readings.range_m) ASSERT_TRUE(std::isfinite(range));
      World largest = apply(design, info.id, info.maximum, random);
      EXPECT_GT(simulate(largest, 1).readings.size(), 1000u) << info.id;
    }
}

TEST(Plants, TableNamesTheCatalogueAndItsPlaces) {
  std::set<std::string> covariates = rangecal::test::covariates;
  covariates.insert({"intensity", "temperature_c"});
  std::set<std::string> ids;
  for (const EffectInfo& info : effect_table()) {
    EXPECT_TRUE(ids.insert(info.id).second) << info.id;
    EXPECT_LE(info.typical, info.maximum) << info.id;
    ASSERT_FALSE(info.channels.empty() || info.covariates.empty()) << info.id;
    for (const std::string& channel : info.channels)
      EXPECT_EQ(rangecal::test::channels.count(channel), 1u) << info.id << channel;
    for (const std::string& name : info.covariates) EXPECT_EQ(covariates.count(name), 1u) << info.id << name;
  }
  // The simulated sensors measure distance, none depth along an axis; what recorded columns and devices do is planted in
  // tables of known distances (apps/proof/everyday.hpp). A spread that is stated wrong is no physics of the world, but what is
  // written beside it (row stated-sigma).
  const std::set<std::string> not_here{
      "axial_depth",  "temperature_coefficient", "power_bias", "covariate_drift",  "device_offset",
      "stated_sigma", "antenna_pattern",         "turn_scale", "range_saturation", "scan_latency"};
  for (const std::string& id : rangecal::test::catalogue)
    EXPECT_EQ(ids.count(id), 1u - not_here.count(id)) << id;
}

TEST(Plants, VanishWithTheirSize) {
  for (const EffectInfo& info : effect_table()) {
    if (info.effect_class != EffectClass::mean && info.effect_class != EffectClass::absorbed) continue;
    const Change large = change_of(make_turning_design(), info.id, info.typical);
    const Change small = change_of(make_turning_design(), info.id, 0.01 * info.typical);
    const double scale = rms(large.range_m) / large.before.range_sd_m[0] + rms(large.bearing_rad) / 0.0087;
    const double rest = rms(small.range_m) / small.before.range_sd_m[0] + rms(small.bearing_rad) / 0.0087;
    EXPECT_LT(rest, 0.03 * scale) << info.id;
  }
}

TEST(Plants, WrongRequestsAreRefused) {
  Random random(1);
  EXPECT_THROW(apply(line(), "no_such_effect", 1.0, random), InputError);
  EXPECT_THROW(apply(line(), "tilt", 3.0, random), InputError);
  EXPECT_THROW(apply(line(), "heavy_tails", -0.1, random), InputError);
  EXPECT_THROW(apply(line(), "tilt", std::nan(""), random), InputError);
}

}  // namespace
}  // namespace rangecal::world::test
