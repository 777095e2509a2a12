// SPDX-License-Identifier: BSD-3-Clause
// What holds for every effect of the folder: registered, described, bounded, linear where it says so, smooth.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "problems/effects/example.hpp"
#include "support/catalogue.hpp"

namespace rangecal {
namespace {

using effects_testing::example_context;
using effects_testing::example_effects;
using effects_testing::example_reading;
using effects_testing::example_stops;

using test::catalogue;
using test::channels;
using test::covariates;

Eigen::Index size_of(const Effect& effect) {
  return static_cast<Eigen::Index>(effect.info().parameters.size());
}

/// All that an effect changes, in one vector: the example reading at each stop, from `near_m` on every `step_m`, the
/// stops, dependence and tail.
Eigen::VectorXd changes(const Effect& effect, const Eigen::VectorXd& p, double near_m = 0.8,
                        double step_m = 0.6) {
  const EffectContext context = example_context();
  std::vector<double> all;
  for (int k = 0; k < context.stop_count; ++k) {
    ReadingView<double> at = example_reading(context);
    at.stop = k;
    at.d = near_m + step_m * k;
    at.axis_distance = at.d + at.radius;
    at.f = 1.02 * at.d;
    at.bearing = -2.5 + k;
    const ReadingChange<double> change = effect.reading(at, p.data());
    all.insert(all.end(),
               {change.range, change.bearing, change.range_log_variance, change.bearing_log_variance});
  }
  if (effect.acts_on_stops()) {
    const std::vector<StopPrior> before = example_stops(context);
    std::vector<StopPrior> after = before;
    effect.stops(context, p.data(), after);
    for (std::size_t k = 0; k < after.size(); ++k)
      all.insert(
          all.end(),
          {after[k].commanded.x_m - before[k].commanded.x_m, after[k].commanded.y_m - before[k].commanded.y_m,
           after[k].commanded.heading_rad - before[k].commanded.heading_rad,
           after[k].sigma_xy_m - before[k].sigma_xy_m,
           after[k].sigma_heading_rad - before[k].sigma_heading_rad, after[k].chained ? 1.0 : 0.0});
  }
  const Dependence dependence = effect.dependence(p.data());
  all.insert(all.end(), {dependence.range_cell_sigma_m, dependence.bearing_cell_sigma_rad,
                         dependence.range_correlation, dependence.bearing_correlation});
  ReadingView<double> seen{};
  seen.d = 2.0;
  seen.radius = 0.1;
  seen.spread = 0.01;
  const Contamination tail = effect.contamination(seen, p.data());
  all.insert(all.end(), {tail.share, tail.extra_sigma_m, tail.mean_m});
  return Eigen::Map<Eigen::VectorXd>(all.data(), static_cast<Eigen::Index>(all.size()));
}

/// d changes / d p_i [any unit per that of p_i] by a central difference of `step`.
Eigen::VectorXd central_slope(const Effect& effect, const Eigen::VectorXd& p, Eigen::Index i, double step,
                              double near_m = 0.8, double step_m = 0.6) {
  Eigen::VectorXd above = p, below = p;
  above[i] += step;
  below[i] -= step;
  return (changes(effect, above, near_m, step_m) - changes(effect, below, near_m, step_m)) / (2.0 * step);
}

/// Typical continuous parameters at the point of the start grid (discrete ones) where they change most.
Eigen::VectorXd typical_point(const Effect& effect) {
  Eigen::VectorXd best;
  double most = -1.0;
  for (const Eigen::VectorXd& start : effect.start_grid(example_context())) {
    Eigen::VectorXd p = start;
    for (Eigen::Index i = 0; i < p.size(); ++i) {
      const EffectParameter& parameter = effect.info().parameters[static_cast<std::size_t>(i)];
      if (!parameter.discrete) p[i] = parameter.typical;
    }
    const double size = changes(effect, p).norm();
    if (size > most) {
      most = size;
      best = p;
    }
  }
  return best;
}

TEST(Effects, TheWholeCatalogueIsRegistered) {
  std::vector<std::string> ids;
  for (const auto& effect : effect_registry()) ids.push_back(effect->info().id);
  EXPECT_THAT(ids, ::testing::UnorderedElementsAreArray(catalogue));
  EXPECT_EQ(find_effect("no_such_effect"), nullptr);
}

TEST(Effects, OneStandsAlongEachColumnThatSuitsIt) {
  EffectContext context = example_context();
  context.covariates.push_back("humidity_percent");
  context.columns.push_back({ColumnRole::other, 50.0, 10.0});
  context.covariates.push_back("supply_v");
  context.columns.push_back({ColumnRole::supply_voltage, 5.0, 0.0});  // never changes
  std::vector<std::string> along;
  for (const Effect* effect : effects_of(context))
    if (!column_in_id(effect->info().id).empty()) along.push_back(effect->info().id);
  EXPECT_THAT(along,
              ::testing::UnorderedElementsAre("antenna_pattern:elevation_rad", "covariate_drift:intensity",
                                              "covariate_drift:humidity_percent", "power_bias:rx_power_dbm",
                                              "temperature_coefficient:temperature_c"));
  EXPECT_EQ(effects_of(context).size(), catalogue.size() + 1);
  context.left_out = {"power_bias"};
  for (const Effect* effect : effects_of(context))
    EXPECT_NE(id_without_column(effect->info().id), "power_bias");
  context.left_out = {"covariate_drift:intensity"};  // along that column alone
  std::vector<std::string> kept;
  for (const Effect* effect : effects_of(context)) kept.push_back(effect->info().id);
  EXPECT_THAT(kept, ::testing::Not(::testing::Contains("covariate_drift:intensity")));
  EXPECT_THAT(kept, ::testing::Contains("covariate_drift:humidity_percent"));
  context.left_out.clear();
  // The kind stands for a column that is lacking, and says so.
  context.covariates = {"rx_power_dbm"};
  context.columns = {{ColumnRole::received_power, -70.0, 4.0}};
  const std::vector<const Effect*> effects = effects_of(context);
  const auto kind = std::find(effects.begin(), effects.end(), find_effect("temperature_coefficient"));
  ASSERT_NE(kind, effects.end());
  EXPECT_EQ((*kind)->missing(context), "a column of the temperature");
  EXPECT_EQ(find_effect("covariate_drift:supply_v"), find_effect("covariate_drift:supply_v"));
  EXPECT_EQ(find_effect("tilt:supply_v"), nullptr);
  EXPECT_EQ(find_effect("covariate_drift:"), nullptr);
  EXPECT_EQ(id_in_words("covariate_drift:supply_v"), "covariate_drift along supply_v");
  EXPECT_EQ(id_without_column("covariate_drift:a:b"), "covariate_drift");
  EXPECT_EQ(column_in_id("covariate_drift:a:b"), "a:b");
}

TEST(Effects, TextsAreThereAndChannelsAreThoseOfTheFormat) {
  for (const Effect* effect : example_effects()) {
    const EffectInfo& info = effect->info();
    SCOPED_TRACE(info.id);
    EXPECT_TRUE(channels.count(info.channel)) << info.channel;
    EXPECT_EQ(covariates.count(info.covariate) + (column_in_id(info.id) == info.covariate), 1u)
        << info.covariate;
    EXPECT_THAT(info.number, ::testing::MatchesRegex("[RBCMWNV][0-9]+"));
    for (const std::string& text :
         {info.physics, info.formula, info.source, info.visible_by, info.settled_by})
      EXPECT_FALSE(text.empty());
    EXPECT_EQ(info.physics.back(), '.');
  }
}

TEST(Effects, ExactTwinsAreMutual) {
  for (const Effect* effect : example_effects())
    for (const std::string& twin : effect->info().exact_twins) {
      SCOPED_TRACE(effect->info().id + " = " + twin);
      if (twin == "heading_zero") continue;  // the robot's, no effect
      EXPECT_THAT(exact_twins_of(twin), ::testing::Contains(effect->info().id));
    }
  EXPECT_THAT(exact_twins_of("bearing_offset"), ::testing::ElementsAre("heading_zero"));
  EXPECT_TRUE(exact_twins_of("no_such_effect").empty());
}

TEST(Effects, ParametersAreNamedAndTypicalOnesWithinBounds) {
  for (const Effect* effect : example_effects()) {
    SCOPED_TRACE(effect->info().id);
    EXPECT_FALSE(effect->info().parameters.empty());
    std::set<std::string> names;
    for (const EffectParameter& parameter : effect->info().parameters) {
      SCOPED_TRACE(parameter.name);
      EXPECT_TRUE(names.insert(parameter.name).second);
      EXPECT_LT(parameter.low, parameter.high);
      EXPECT_GT(parameter.typical, 0.0);
      EXPECT_GE(parameter.typical, parameter.low);
      EXPECT_LE(parameter.typical, parameter.high);
      EXPECT_FALSE(parameter.linear && parameter.discrete);
      if (parameter.linear) {
        EXPECT_LE(parameter.low, 0.0);
      }
    }
  }
}

TEST(Effects, StartGridsAreFilledAndWithinBounds) {
  EffectContext near = example_context(), plain = example_context();
  near.range_min_m = 0.2;
  near.range_max_m = 12.0;
  plain.covariates.clear();
  plain.duration_s = 0.0;
  plain.stop_time_s.clear();
  for (const EffectContext& context : {example_context(), near, plain})
    for (const Effect* effect : example_effects()) {
      SCOPED_TRACE(effect->info().id);
      const std::vector<Eigen::VectorXd> grid = effect->start_grid(context);
      ASSERT_FALSE(grid.empty());
      EXPECT_LE(grid.size(), 1200u);
      for (const Eigen::VectorXd& p : grid) {
        ASSERT_EQ(p.size(), size_of(*effect));
        for (Eigen::Index i = 0; i < p.size(); ++i) {
          const EffectParameter& parameter = effect->info().parameters[static_cast<std::size_t>(i)];
          ASSERT_GE(p[i], parameter.low) << parameter.name;
          ASSERT_LE(p[i], parameter.high) << parameter.name;
          if (parameter.linear) {
            ASSERT_EQ(p[i], 0.0) << parameter.name;
          }
        }
      }
    }
}

TEST(Effects, EveryEffectChangesSomethingButLabels) {
  for (const Effect* effect : example_effects()) {
    if (effect->info().kind == EffectKind::label) continue;
    EXPECT_GT(changes(*effect, typical_point(*effect)).norm(), 0.0) << effect->info().id;
  }
}

TEST(Effects, ThoseThatAreTheSameForRepeatsSaySo) {
  const EffectContext context = example_context();
  const auto as_vector = [](const ReadingChange<double>& change) {
    return Eigen::Vector4d(change.range, change.bearing, change.range_log_variance,
                           change.bearing_log_variance);
  };
  for (const Effect* effect : example_effects()) {
    const Eigen::VectorXd p = typical_point(*effect);
    double size = 0.0, difference = 0.0;
    for (int k = 0; k < context.stop_count; ++k) {
      ReadingView<double> at = example_reading(context);
      std::vector<double> columns(context.covariates.size(), 0.0);
      at.covariate = columns.data();
      at.stop = k;
      at.d = 0.8 + 0.6 * k;
      const Eigen::Vector4d first = as_vector(effect->reading(at, p.data()));
      at.repeat += 3;
      at.time_s += 7.0;
      at.time += 0.05;
      at.rate_mps += 0.3;
      for (double& column : columns) column += 2.0;
      const Eigen::Vector4d later = as_vector(effect->reading(at, p.data()));
      size += first.lpNorm<1>() + later.lpNorm<1>();
      difference += (later - first).lpNorm<1>();
    }
    if (size > 0.0 && effect->info().kind != EffectKind::grid && !effect->noise_before_reciprocal()) {
      EXPECT_EQ(effect->differs_between_repeats(), difference > 0.0) << effect->info().id;
    }
  }
}

TEST(Effects, LinearParametersAreLinearAndVanishAtZero) {
  for (const Effect* effect : example_effects()) {
    const auto& parameters = effect->info().parameters;
    if (std::none_of(parameters.begin(), parameters.end(), [](const auto& one) { return one.linear; }))
      continue;
    SCOPED_TRACE(effect->info().id);
    const Eigen::VectorXd typical = typical_point(*effect);
    const auto scaled = [&](double factor) {
      Eigen::VectorXd p = typical;
      for (std::size_t i = 0; i < parameters.size(); ++i)
        if (parameters[i].linear) p[static_cast<Eigen::Index>(i)] *= factor;
      return changes(*effect, p);
    };
    EXPECT_EQ(scaled(0.0).norm(), 0.0);
    // The curve's bend, the arc of a curved path and asin add terms of second order: relative 1e-4 of what
    // they are at the typical size in the first check, up to a tenth in the second.
    // axial_depth moves d by metres at its typical size, where the bend counts in full, noise_law takes the logarithm of a
    // sum of variances, and the harmonics of pixel_locking grow with the cube of its size: they are tried at a twentieth, a
    // hundredth and three tenths.
    const std::string& id = effect->info().id;
    const double size = id == "axial_depth"     ? 0.05
                        : id == "noise_law"     ? 0.01
                        : id == "pixel_locking" ? 0.3
                                                : 1.0;
    EXPECT_LE((scaled(2e-4 * size) - 2.0 * scaled(1e-4 * size)).norm(), 1e-4 * scaled(1e-4 * size).norm());
    EXPECT_LE((scaled(2.0 * size) - 2.0 * scaled(size)).norm(), 0.1 * scaled(size).norm());
  }
}

TEST(Effects, ContinuousParametersActSmoothly) {
  for (const Effect* effect : example_effects()) {
    const Eigen::VectorXd typical = typical_point(*effect);
    for (Eigen::Index i = 0; i < size_of(*effect); ++i) {
      const EffectParameter& parameter = effect->info().parameters[static_cast<std::size_t>(i)];
      if (parameter.discrete) continue;
      SCOPED_TRACE(effect->info().id + "." + parameter.name);
      // Truncation at a step h of 1e-5 typical sizes is below h^2 |f'''|; rounding about 1e-16 / h of the
      // values.
      const Eigen::VectorXd coarse = central_slope(*effect, typical, i, 2e-5 * parameter.typical),
                            fine = central_slope(*effect, typical, i, 1e-5 * parameter.typical);
      ASSERT_TRUE(fine.allFinite());
      EXPECT_LE((coarse - fine).norm(), 1e-5 * fine.norm() + 1e-9 / parameter.typical);
    }
  }
}

TEST(Effects, TheStepOfADerivativeIsShortAndNotTooShort) {
  // From 0.15 to 0.65 m, where a wavenumber of 1/d turns the phase by thousands of radians: the slope by h against that by
  // h / 10. Truncation at h is (h k / d)^2 / 6 = (1e-6 * 5000)^2 / 6 = 4e-6 of the slope at most, rounding at h / 10 some
  // 1e-9 of what the effect changes per typical size. A step of a thousandth is off by more than the slope.
  for (const Effect* effect : example_effects()) {
    const auto& parameters = effect->info().parameters;
    const Eigen::VectorXd typical = typical_point(*effect);
    Eigen::VectorXd zero = typical;
    for (Eigen::Index i = 0; i < zero.size(); ++i)
      if (parameters[static_cast<std::size_t>(i)].linear) zero[i] = 0.0;
    for (const Eigen::VectorXd& point : {typical, zero})
      for (Eigen::Index i = 0; i < size_of(*effect); ++i) {
        const EffectParameter& parameter = parameters[static_cast<std::size_t>(i)];
        if (parameter.discrete) continue;
        SCOPED_TRACE(effect->info().id + "." + parameter.name);
        const double h = difference_step(parameter, point[i]);
        const Eigen::VectorXd coarse = central_slope(*effect, point, i, h, 0.15, 0.1),
                              fine = central_slope(*effect, point, i, 0.1 * h, 0.15, 0.1);
        const double size = changes(*effect, point, 0.15, 0.1).norm();
        ASSERT_TRUE(fine.allFinite());
        EXPECT_LE((coarse - fine).norm(), 1e-5 * fine.norm() + 1e-8 * size / parameter.typical);
      }
  }
}

TEST(Effects, TheStepFollowsThePhysicsOfTheParameter) {
  const EffectParameter length{.name = "offset_m", .typical = 0.005, .low = -1.0, .high = 1.0};
  EXPECT_DOUBLE_EQ(difference_step(length, 0.0), 5e-9);
  EXPECT_DOUBLE_EQ(difference_step(length, -0.3), 5e-9);
  // A time constant of a millisecond beside a typical one of minutes: a step of the latter would turn its sign.
  const EffectParameter time{.name = "time_s", .typical = 600.0, .low = 1e-3, .high = 1e6, .linear = false};
  EXPECT_DOUBLE_EQ(difference_step(time, 1e-3), 1e-9);
  EXPECT_DOUBLE_EQ(difference_step(time, 1e5), 0.1);
  EXPECT_GT(difference_step({.name = "none"}, 0.0), 0.0);
}

TEST(Effects, WhatIsMissingIsSaid) {
  const EffectContext full = example_context();
  EffectContext bare = full, pairs = full;
  bare.duration_s = 0.0;
  bare.stop_time_s.clear();
  bare.largest_cell = 1.0;
  bare.covariates.clear();
  pairs.kind = RecordingKind::pairs;
  std::set<std::string> lacking, not_for_pairs;
  for (const Effect* effect : example_effects()) {
    EffectContext suits = effect->info().id == "device_offset" ? pairs : full;
    if (effect->info().id == "range_saturation") suits.range_max_m = 30.0;
    EXPECT_EQ(effect->missing(suits), "") << effect->info().id;
    if (!effect->missing(bare).empty()) lacking.insert(effect->info().id);
    if (!effect->missing(pairs).empty()) not_for_pairs.insert(effect->info().id);
    if (effect->acts_on_stops()) {
      EXPECT_FALSE(effect->missing(pairs).empty()) << effect->info().id;
    }
  }
  EXPECT_THAT(lacking,
              ::testing::ElementsAre("antenna_pattern:elevation_rad", "autocorrelated_noise", "bearing_drift",
                                     "bearing_quantisation", "cell_effect", "covariate_drift:intensity",
                                     "device_offset", "heading_drift", "power_bias:rx_power_dbm",
                                     "range_saturation", "scan_latency", "settling",
                                     "temperature_coefficient:temperature_c", "warmup_drift"));
  EXPECT_TRUE(not_for_pairs.count("lever_arm"));
  EXPECT_FALSE(not_for_pairs.count("pixel_locking"));
  EXPECT_THAT(find_effect("warmup_drift")->missing(bare), ::testing::HasSubstr("time_s"));
  EXPECT_THAT(find_effect("cell_effect")->missing(bare), ::testing::HasSubstr("repeats"));
  EffectContext one_direction = pairs;
  one_direction.largest_bearing_rad = 0.0;
  for (const char* id : {"range_eccentricity", "tilt", "ambient_light"})
    EXPECT_THAT(find_effect(id)->missing(one_direction), ::testing::HasSubstr("bearing_rad")) << id;
}

TEST(Effects, PhaseBetweenNeighbouringWavenumbersIsSmall) {
  const EffectContext context = example_context();
  // pixel locking: at most 2 rad over the span of 1/d, that is 1 rad about its middle; cyclic error: 1 rad
  // over that of d
  const auto locking = find_effect("pixel_locking")->start_grid(context);
  const auto cyclic = find_effect("cyclic_error")->start_grid(context);
  EXPECT_LE((locking[1][2] - locking[0][2]) * (1.0 / 0.5 - 1.0 / 4.5), 2.0 + 1e-9);
  EXPECT_LE(cyclic.size(), 400u);
  EXPECT_LE((cyclic[1][2] - cyclic[0][2]) * (4.5 - 0.5), 1.0 + 0.3);  // 491 points wanted, 400 given
}

TEST(Effects, ASensorHasThoseOfWhatItMeasuresWith) {
  EXPECT_EQ(carrier_of("HC-SR04 Sonar"), Carrier::sound);
  EXPECT_EQ(carrier_of("ultrasonic"), Carrier::sound);
  EXPECT_EQ(carrier_of("UWB, two-way ranging"), Carrier::radio);
  EXPECT_EQ(carrier_of("triangulation"), Carrier::light);
  EXPECT_EQ(carrier_of("lidar, phase shift"), Carrier::light);
  EXPECT_EQ(carrier_of("phase"), Carrier::not_known);
  EXPECT_EQ(carrier_of(""), Carrier::not_known);
  EffectContext context = effects_testing::example_context();
  const auto has = [&](Carrier carrier, const char* id) {
    context.carrier = carrier;
    const std::vector<const Effect*> effects = effects_of(context);
    return std::count(effects.begin(), effects.end(), find_effect(id)) > 0;
  };
  for (const Carrier carrier : {Carrier::not_known, Carrier::light, Carrier::sound, Carrier::radio}) {
    const bool light = carrier == Carrier::light || carrier == Carrier::not_known;
    EXPECT_EQ(has(carrier, "lens_distortion"), light);
    EXPECT_EQ(has(carrier, "axial_depth"), light);
    EXPECT_TRUE(has(carrier, "near_regime"));
    EXPECT_TRUE(has(carrier, "late_return"));
  }
}

TEST(Effects, WhereNoPrincipleIsStatedTheNameOrAReceivedPowerSaysWhatASensorMeasuresWith) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  EXPECT_EQ(carrier_of(recording), Carrier::not_known);
  recording.pairs.covariates["temperature_c"] = {20.0};
  recording.pairs.covariates["snr_db"] = {10.0};
  EXPECT_EQ(carrier_of(recording), Carrier::not_known);
  recording.pairs.covariates["rssi_dbm"] = {-80.0};
  EXPECT_EQ(carrier_of(recording), Carrier::radio);
  recording.sensor.name = "barcode-camera";
  EXPECT_EQ(carrier_of(recording), Carrier::light);
  recording.sensor.principle = "sonar";
  EXPECT_EQ(carrier_of(recording), Carrier::sound);
}

}  // namespace
}  // namespace rangecal
