// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/effects/formula_effect.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <tuple>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/random.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using test::TemporaryFolder;

const std::string head = "effect: ours\nphysics: p\nsettled_by: s\n";
const std::string amplitude = "parameters: {a: {unit: m, typical: 0.01, from: -1, to: 1}}\n";

std::string error_of(const std::string& yaml) {
  try {
    effect_from_formula(yaml, "ours.yaml");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

/// Of a formula of the range with the parameters of `amplitude`, or others.
std::string error_of_formula(const std::string& formula, const std::string& parameters = amplitude) {
  return error_of(head + "channel: range\nformula: \"" + formula + "\"\n" + parameters);
}

/// A reading somewhere, drawn.
struct SomeReading {
  EffectContext context;
  double column = 0.0;
  ReadingView<double> at{};
  explicit SomeReading(Random& random) {
    context.duration_s = 500.0;
    context.covariates = {"current_a"};
    column = random.uniform(0.1, 3.0);
    at.d = random.uniform(0.3, 5.0);
    at.radius = 0.1;
    at.axis_distance = at.d + at.radius;
    at.bearing = random.uniform(-3.0, 3.0);
    at.f = 0.02 + 1.1 * at.d;
    at.slope = 1.1;
    at.time_s = random.uniform(0.0, 500.0);
    at.time = at.time_s / 500.0;
    at.landmark = static_cast<int>(random.index(4));
    at.covariate = &column;
    at.context = &context;
  }
};

TEST(FormulaEffect, OneOfTheCatalogueWrittenAsAFormulaGivesTheSameNumbers) {
  int written = 0;
  for (const Effect* own : known_effects()) {
    const std::string yaml = as_formula(*own);
    if (yaml.empty()) continue;
    ++written;
    const auto effect = effect_from_formula(yaml, own->info().id);
    EXPECT_EQ(effect->info().id, "my_" + own->info().id);
    EXPECT_EQ(effect->info().channel, own->info().channel);
    ASSERT_EQ(effect->info().parameters.size(), own->info().parameters.size());
    Random random(seed_from("FormulaEffect.Catalogue"));
    for (int i = 0; i < 100; ++i) {
      const SomeReading some(random);
      std::vector<double> p;
      for (const EffectParameter& one : own->info().parameters)
        p.push_back(one.typical * random.uniform(0.5, 1.5));
      const ReadingChange<double> by_class = own->reading(some.at, p.data()),
                                  by_formula = effect->reading(some.at, p.data());
      EXPECT_NEAR(by_formula.range, by_class.range, 1e-12 * (1.0 + std::abs(by_class.range))) << yaml;
      EXPECT_NEAR(by_formula.bearing, by_class.bearing, 1e-12) << yaml;
    }
  }
  EXPECT_EQ(written, 15);  // those of which docs/effects-by-formula.md can give a start
}

TEST(FormulaEffect, ParametersThatItIsLinearInAreFound) {
  const auto effect = effect_from_formula(
      head +
          "channel: bearing\nformula: a*cos(k*d) + c*a/d0*d + n*0*a\n"
          "parameters:\n  a: {unit: rad, typical: 0.01, from: -1, to: 1}\n  c: {typical: 1, from: -5, to: 5}\n"
          "  k: {unit: 1/m, typical: 3, from: 1, to: 100, starts: 7}\n  n: {integer: true, from: 2, to: 5}\n"
          "  d0: {unit: m, typical: 1, from: 0.5, to: 2}\n",
      "ours.yaml");
  const std::vector<EffectParameter>& p = effect->info().parameters;
  EXPECT_TRUE(p[0].linear);
  EXPECT_FALSE(p[1].linear);  // a product with one that is
  EXPECT_FALSE(p[2].linear);
  EXPECT_TRUE(p[3].discrete);
  EXPECT_EQ(p[0].name, "a_rad");
  EXPECT_EQ(p[2].name, "k_per_m");
  // k: 7 starts from 1 to 100 in equal ratios; n: 2, 3, 4, 5; c and d0, of three that are not linear, 4 each.
  const auto grid = effect->start_grid({});
  EXPECT_EQ(grid.size(), 7u * 4u * 4u * 4u);
  EXPECT_DOUBLE_EQ(grid.front()[2], 1.0);
  EXPECT_NEAR(grid.back()[2], 100.0, 1e-9);
}

TEST(FormulaEffect, UnitsOfParametersAreReadOffTheirNames) {
  for (const auto& [full, name, unit] :
       {std::tuple{"amplitude_m", "amplitude", "m"},
        {"axis_rad", "axis", "rad"},
        {"cosine_rad2", "cosine", "rad^2"},
        {"inverse_m2", "inverse", "m^2"},
        {"delay_s", "delay", "s"},
        {"slope_m_per_k", "slope", "m/K"},
        {"curvature_per_m", "curvature", "1/m"},
        {"a1_m_per_rad", "a1", "m/rad"},
        {"a1_per_rad2", "a1", "1/rad^2"},
        {"k1_per_db", "k1", "1/dB"},
        {"a_m_per_k_s", "a", "m/K/s"},
        {"kappa", "kappa", "1"},
        {"m", "m", "1"},
        {"part_a", "part_a", "1"},
        {"drift_per_door", "drift_per_door", "1"},
        {"power_bias:rx_power_dbm.slope_m_per_db", "power_bias:rx_power_dbm.slope", "m/dB"}}) {
    EXPECT_EQ(parameter_name(full).name, name) << full;
    EXPECT_EQ(parameter_name(full).unit, unit) << full;
  }
}

TEST(FormulaEffect, FitsOfALawWithValuesStartThere) {
  std::string formula, parameters;
  for (int i = 1; i <= 8; ++i) {  // 8 periods from 16 starts each are more than any fit could try
    formula += fmt::format("{}a{}*cos(k{}*d)", i == 1 ? "" : " + ", i, i);
    parameters += fmt::format(
        "  a{}: {{unit: m, typical: 0.01, from: -1, to: 1, value: 0.02}}\n"
        "  k{}: {{unit: 1/m, typical: 2, from: 1, to: 90, value: {}}}\n",
        i, i, 10 * i);
  }
  const auto law =
      effect_from_formula("effect: law\nphysics: p\nsettled_by: s\nchannel: range\nformula: " + formula +
                              "\nparameters:\n" + parameters,
                          "law");
  const auto grid = law->start_grid({});
  ASSERT_EQ(grid.size(), 1u);
  EXPECT_EQ(grid[0][0], 0.0);   // a1: linear
  EXPECT_EQ(grid[0][1], 10.0);  // k1
  EXPECT_EQ(grid[0][15], 80.0);
}

TEST(FormulaEffect, ItsSlopeIsThatOfDifferences) {
  const auto effect = effect_from_formula(
      head +
          "channel: range\nformula: (a + b1*d)*exp(-t/T)*current_a\ncolumns: {current_a: {unit: \"1\"}}\n"
          "parameters:\n  a: {unit: m, typical: 0.01, from: -1, to: 1}\n  b1: {typical: 0.01, from: -1, to: 1}\n"
          "  T: {unit: s, typical: 100, from: 10, to: 1000}\n",
      "ours.yaml");
  Random random(seed_from("FormulaEffect.Slope"));
  const SomeReading some(random);
  const double p[] = {0.02, -0.01, 200.0};
  for (int j = 0; j < 2; ++j) {
    double up[] = {p[0], p[1], p[2]}, down[] = {p[0], p[1], p[2]};
    up[j] += 1e-3;
    down[j] -= 1e-3;
    const double difference =
        (effect->reading(some.at, up).range - effect->reading(some.at, down).range) / 2e-3;
    ASSERT_TRUE(effect->slope(some.at, p, j));
    EXPECT_NEAR(effect->slope(some.at, p, j)->range, difference, 1e-11);
  }
  EXPECT_FALSE(effect->slope(some.at, p, 2));  // not linear in it: differences
  // By hand: (0.02 - 0.01 d) exp(-t / 200) current.
  EXPECT_DOUBLE_EQ(effect->reading(some.at, p).range,
                   (0.02 - 0.01 * some.at.d) * std::exp(-some.at.time_s / 200.0) * some.column);
}

TEST(FormulaEffect, AReadingWithoutItsColumnIsNotChanged) {
  const auto effect = effect_from_formula(
      head + "channel: range\nformula: a*current_a\ncolumns: {current_a: {unit: \"1\"}}\n" + amplitude,
      "ours.yaml");
  Random random(seed_from("FormulaEffect.Column"));
  SomeReading some(random);
  const double p[] = {0.01};
  EXPECT_DOUBLE_EQ(effect->reading(some.at, p).range, 0.01 * some.column);
  some.column = std::nan("");
  EXPECT_EQ(effect->reading(some.at, p).range, 0.0);
  EXPECT_EQ(effect->missing(EffectContext{}), "a column current_a");
  EXPECT_EQ(effect->missing(some.context), "");
  EXPECT_EQ(effect->info().covariate, "current_a");
}

TEST(FormulaEffect, ActingOnTheDistanceTheSpreadGoesAlong) {
  const auto effect =
      effect_from_formula(head + "channel: range\nacts: distance\nformula: a\n" + amplitude, "ours.yaml");
  ReadingView<double> at{};
  at.d = 2.0, at.f = 2.0, at.slope = 0.9, at.spread_power = 2;
  const double p[] = {0.1};
  EXPECT_DOUBLE_EQ(effect->reading(at, p).range, 0.09);
  EXPECT_DOUBLE_EQ(effect->reading(at, p).range_log_variance, 4.0 * std::log(1.0 + 0.09 / 2.0));
  EXPECT_TRUE(effect->changes_with_distance());
}

TEST(FormulaEffect, AShareOfOutliersOnOneSide) {
  const auto effect = effect_from_formula(
      head +
          "channel: outlier_share\nformula: p*d/d0\nconstants: {d0: {unit: m, value: 2}}\noutliers: {side: early, size: tau}\n"
          "parameters:\n  p: {typical: 0.05, from: 0, to: 0.5}\n  tau: {unit: m, typical: 0.3, from: 0.01, to: 5}\n",
      "ours.yaml");
  EXPECT_EQ(effect->info().channel, "range_tail");
  ReadingView<double> at{};
  at.d = 3.0, at.f = 3.1;
  const double p[] = {0.1, 0.25};
  const Contamination law = effect->contamination(at, p);
  EXPECT_DOUBLE_EQ(law.share, 0.15);
  EXPECT_DOUBLE_EQ(law.mean_m, -0.25);
  EXPECT_DOUBLE_EQ(law.end_m, 3.1);
}

TEST(FormulaEffect, WhatCannotBeReadIsSaidByRowAndCharacter) {
  EXPECT_EQ(error_of_formula("a*cos(b"),
            "ours.yaml, row 5: field 'formula': missing parenthesis (at its character 8)");
  EXPECT_EQ(error_of_formula("a*foo(b)"),
            "ours.yaml, row 5: field 'formula': unexpected parenthesis \"(\" at position 5");
  EXPECT_EQ(
      error_of_formula("a = 3"),
      "ours.yaml, row 5: field 'formula': '=' assigns a value; write == to compare (at its character 3)");
  EXPECT_EQ(error_of_formula("a*b; a"),
            "ours.yaml, row 5: field 'formula': ';' has no meaning in a formula (at its character 4)");
  EXPECT_EQ(error_of_formula("a*b, a"),
            "ours.yaml, row 5: field 'formula': holds several formulas, separated by commas");
  EXPECT_EQ(error_of_formula("  "), "ours.yaml, row 5: field 'formula': is empty");
  EXPECT_EQ(error_of_formula(std::string(1000, '(') + "a"),
            "ours.yaml, row 5: field 'formula': brackets are nested deeper than 100 (at its character 101)");
  EXPECT_EQ(error_of_formula(std::string(100000, '(')),
            "ours.yaml, row 5: field 'formula': is longer than 2000 characters (at its character 2001)");
}

TEST(FormulaEffect, WhatIsNoNumberIsRefusedWithThePlace) {
  EXPECT_NE(error_of_formula("a/(b - b)").find("'formula': is no finite number at a = "), std::string::npos);
  EXPECT_NE(error_of_formula("a*sqrt(-1 - b^2)").find("is no finite number at"), std::string::npos);
  EXPECT_NE(error_of_formula("a*log10(b - 10)").find("is no finite number at"), std::string::npos);
}

TEST(FormulaEffect, UnitsHaveToFit) {
  EXPECT_EQ(error_of_formula("a*cos(3*b)"), "no error");
  EXPECT_NE(error_of_formula("a*cos(3*d)").find("its units do not give m"), std::string::npos);
  EXPECT_NE(error_of_formula("a*d").find("its units do not give m: measured in another unit than m"),
            std::string::npos);
  EXPECT_NE(error_of_formula("a*(d - 0.3)/d").find("its units do not give m"), std::string::npos);
  EXPECT_EQ(error_of_formula("a*(d - d0)/d", amplitude + "constants: {d0: {unit: m, value: 0.3}}\n"),
            "no error");
  EXPECT_NE(error_of_formula("a*(temperature_c - t0)", amplitude + "constants: {t0: {unit: K, value: 20}}\n")
                .find("measured in another unit than K"),
            std::string::npos);
  EXPECT_EQ(error_of_formula("a*(temperature_c - t0)",
                             "constants: {t0: {unit: degC, value: 20}}\n"
                             "parameters: {a: {unit: m/K, typical: 1e-3, from: -1, to: 1}}\n"),
            "no error");
  EXPECT_EQ(error_of_formula("a*b", "parameters: {a: {unit: m^0, typical: 1, from: 0, to: 2}}\n"),
            "ours.yaml, row 6: field 'parameters.a.unit': 'm^0' has no power from -9 to 9, other than 0");
}

TEST(FormulaEffect, APartThatBelongsToNoParameterIsRefused) {
  EXPECT_NE(error_of_formula("a*b + 0.1*d").find("does not vanish where a is 0"), std::string::npos);
  EXPECT_EQ(error_of_formula("0.1*d"), "ours.yaml, row 6: field 'parameters': the formula does not use 'a'");
}

TEST(FormulaEffect, FieldsNamesAndBounds) {
  EXPECT_EQ(error_of("effect: ours\n"), "ours.yaml, row 1: field 'physics': is missing");
  EXPECT_NE(error_of(head + "chanel: range\n").find("field 'chanel': unknown key"), std::string::npos);
  EXPECT_NE(
      error_of(head + "channel: pitch\nformula: a\n" + amplitude).find("'pitch' is none of range, bearing"),
      std::string::npos);
  EXPECT_EQ(error_of_formula("a*d", "parameters: {d: {typical: 1, from: 0, to: 2}}\n"),
            "ours.yaml, row 6: field 'parameters.d': 'd' has a meaning already");
  EXPECT_EQ(error_of_formula("sin*d", "parameters: {sin: {typical: 1, from: 0, to: 2}}\n"),
            "ours.yaml, row 6: field 'parameters.sin': 'sin' is a function");
  EXPECT_EQ(error_of_formula("a", "parameters: {a: {unit: m, typical: 1, from: 2, to: 1}}\n"),
            "ours.yaml, row 6: field 'parameters.a': 'from' is not below 'to'");
  EXPECT_EQ(error_of_formula("a", "parameters: {a: {unit: m, typical: 3, from: 0, to: 1}}\n"),
            "ours.yaml, row 6: field 'parameters.a.typical': is not between 'from' and 'to'");
  EXPECT_NE(error_of_formula("n*d", "parameters: {n: {integer: true, from: 0, to: 5000}}\n")
                .find("at most a thousand above"),
            std::string::npos);
  EXPECT_NE(
      error_of(head + "channel: outlier_share\nformula: a\n" + amplitude).find("field 'outliers' is missing"),
      std::string::npos);
}

TEST(FormulaEffect, AFolderOfThemIsAddedOnce) {
  const TemporaryFolder folder;
  const auto with = [&](const std::string& name, const std::string& id, const std::string& formula) {
    write_file(folder.file(name), "effect: " + id + "\nphysics: p\nsettled_by: s\nchannel: range\nformula: " +
                                      formula + "\n" + amplitude);
  };
  with("one.yaml", "folder_test_wave", "a*cos(5*b)");
  EXPECT_EQ(add_effects_by_formula(folder.path()), std::vector<std::string>{"folder_test_wave"});
  ASSERT_NE(find_effect("folder_test_wave"), nullptr);
  EXPECT_EQ(known_effects().back(), find_effect("folder_test_wave"));
  EXPECT_NO_THROW(add_effects_by_formula(folder.path()));  // the same text
  with("one.yaml", "folder_test_wave", "a*cos(6*b)");
  EXPECT_THROW(add_effects_by_formula(folder.path()), InputError);
  with("one.yaml", "tilt", "a*cos(6*b)");
  EXPECT_THROW(add_effects_by_formula(folder.path()), InputError);
  EXPECT_THROW(add_effects_by_formula("/nowhere/at/all"), InputError);

  const TemporaryFolder other;
  write_file(other.file("two.yaml"), head + "channel: range\nformula: a*nowhere\n" + amplitude);
  add_effects_by_formula(other.path());
  Recording recording;
  recording.readings.covariates["current_a"] = {};
  try {
    require_columns_of_formulas(std::span(&recording, 1));
    ADD_FAILURE() << "no column of that name, and no error";
  } catch (const InputError& error) {
    EXPECT_STREQ(
        error.what(),
        "effect ours: 'nowhere' is neither a parameter, nor one of b, d, duration, f, heading, landmark, radius, "
        "repeat, stop, t, nor a column of the recordings (current_a)");
  }
}

}  // namespace
}  // namespace rangecal
