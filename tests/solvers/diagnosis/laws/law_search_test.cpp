// SPDX-License-Identifier: BSD-3-Clause
// From what has no name to a formula, and what another recording says of it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <functional>
#include <string>
#include <vector>

#include "diagnosis/laws/pieces.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"
#include "rangecal/solvers/diagnosis/predict_law.hpp"
#include "solvers/diagnosis/made_recordings.hpp"

namespace rangecal {
namespace {

using testing::recording_of;
using testing::Sensor;

constexpr double amplitude = 0.02;

/// Readings all around, the bearings turned by `turned(b)`, the ranges longer by `longer(y, b)`.
Recording changed(const std::string& name, std::uint64_t seed, const std::function<double(double)>& turned,
                  const std::function<double(double, double)>& longer) {
  Recording recording = recording_of({.sigma = 0.004}, name, seed);
  Readings& r = recording.readings;
  for (std::size_t i = 0; i < r.size(); ++i) {
    const double b = r.bearing_rad[i], y = r.range_m[i];
    r.bearing_rad[i] = wrap_angle(b + turned(b));
    r.range_m[i] = y + longer(y, b);
  }
  return recording;
}

double nothing(double) { return 0.0; }
double ripple(double b) { return amplitude * std::sin(7.0 * b + 0.4); }
double no_change(double, double) { return 0.0; }
double trefoil(double, double b) { return amplitude * std::cos(3.0 * b - 1.0); }

Diagnosis diagnosed(const Recording& recording) {
  DiagnoseOptions options;
  options.laws = true;
  options.held_out = options.unseen = options.next_experiments = false;
  return diagnose(std::span(&recording, 1), options);
}

std::vector<Law> laws_of(const Recording& recording) { return diagnosed(recording).laws; }

/// Share of the squares of a change over all directions that a law of the direction leaves.
double left_by(const Law& law, const std::function<double(double)>& change) {
  const auto effect = effect_from_formula(law.text, "law");
  const StatedValues found = stated_values(*effect);
  double left = 0.0, all = 0.0;
  for (double b = -3.1; b < 3.1; b += 0.01) {
    ReadingView<double> at{};
    at.d = at.f = 2.0;
    at.bearing = b;
    const ReadingChange<double> by_law = effect->reading(at, found.value.data());
    left += std::pow(change(b) - by_law.bearing - by_law.range, 2);
    all += std::pow(change(b), 2);
  }
  return left / all;
}

TEST(Laws, ARippleOfTheBearingIsFoundWithItsOrder) {
  const std::vector<Law> laws = laws_of(changed("Laws.Ripple", 1, ripple, no_change));
  ASSERT_FALSE(laws.empty());
  EXPECT_EQ(laws[0].channel, "bearing");
  EXPECT_EQ(laws[0].variables, std::vector<std::string>{"b"});
  EXPECT_LT(left_by(laws[0], ripple), 0.05) << laws[0].formula;
  EXPECT_GT(laws[0].log_evidence_over_curve, 0.0);
  const auto order = std::find_if(laws[0].parameters.begin(), laws[0].parameters.end(),
                                  [](const EffectEstimate& e) { return e.name == "n1"; });
  ASSERT_NE(order, laws[0].parameters.end());
  EXPECT_EQ(order->estimate, 7.0);
  EXPECT_TRUE(laws[0].agrees_with_first);
}

TEST(Laws, ATrefoilOfTheRangeIsFoundAndPredictsAnotherRoom) {
  const std::vector<Law> laws = laws_of(changed("Laws.Trefoil", 1, nothing, trefoil));
  ASSERT_FALSE(laws.empty());
  EXPECT_EQ(laws[0].channel, "range");
  EXPECT_LT(left_by(laws[0], [](double b) { return trefoil(0.0, b); }), 0.05) << laws[0].formula;

  const auto law = effect_from_formula(laws[0].text, "law");
  const StatedValues found = stated_values(*law);
  ASSERT_EQ(found.value.size(), static_cast<Eigen::Index>(law->info().parameters.size()));
  const auto of = [&](const Recording& other) { return predict_law(*law, found, std::span(&other, 1)); };

  const LawPrediction with = of(changed("Laws.Trefoil", 2, nothing, trefoil));
  EXPECT_EQ(with.verdict, LawVerdict::confirmed) << with.size << " +- " << with.size_std;
  ASSERT_TRUE(with.heldout_gain);
  EXPECT_GT(*with.heldout_gain, 10.0);

  const LawPrediction without = of(changed("Laws.Trefoil", 3, nothing, no_change));
  EXPECT_EQ(without.verdict, LawVerdict::refuted) << without.size << " +- " << without.size_std;
  ASSERT_TRUE(without.heldout_gain);
  EXPECT_LT(*without.heldout_gain, -10.0);

  const LawPrediction twice =
      of(changed("Laws.Trefoil", 4, nothing, [](double y, double b) { return 2.0 * trefoil(y, b); }));
  EXPECT_EQ(twice.verdict, LawVerdict::another_size) << twice.size << " +- " << twice.size_std;
  EXPECT_NEAR(twice.size, 2.0, 0.4);

  Sensor ahead{.sigma = 0.05};
  ahead.looks_one_way = true;
  ahead.fan_rad = 0.05;
  const LawPrediction blind = of(recording_of(ahead, "Laws.Blind", 1));
  EXPECT_EQ(blind.verdict, LawVerdict::not_tested) << blind.size << " +- " << blind.size_std;
  EXPECT_TRUE(blind.would_test.empty()) << "it acts in every direction: " << blind.would_test;
  ASSERT_TRUE(blind.times_the_readings);
  // s is to be known to a sixth, of which the law's own uncertainty takes its part.
  EXPECT_NEAR(*blind.times_the_readings,
              std::pow(blind.size_std, 2) / (1.0 / 36.0 - std::pow(blind.found_std, 2)), 1e-9);
}

TEST(Laws, WhereALawIsNotTestedTheReadingsThatWouldAreSaid) {
  const std::string text =
      "effect: guard\nphysics: \"a cable guard\"\nsettled_by: \"take it off\"\nchannel: range\nformula: \"a*exp(-((b - m)/w)^2)\"\nparameters:\n"
      "  a: {unit: m, from: -1, to: 1, typical: 0.01, value: 0.02, std: 0.002}\n"
      "  m: {unit: rad, from: -4, to: 4, typical: 2, value: 2.0, std: 0.01}\n"
      "  w: {unit: rad, from: 0.1, to: 1, typical: 0.3, value: 0.3, std: 0.01}\n";
  const auto guard = effect_from_formula(text, "guard");
  Sensor ahead{.sigma = 0.004};
  ahead.looks_one_way = true;
  ahead.fan_rad = 0.6;  // nothing is seen at 2 rad
  const Recording recording = recording_of(ahead, "Laws.Elsewhere", 1);
  const LawPrediction p = predict_law(*guard, stated_values(*guard), std::span(&recording, 1));
  EXPECT_EQ(p.verdict, LawVerdict::not_tested) << p.size << " +- " << p.size_std;
  // Half of its height: 2 +- 0.3 sqrt(ln 2) = 1.75 to 2.25.
  EXPECT_EQ(p.would_test.substr(0, 29), "readings with b from 1.75 to ") << p.would_test;
  EXPECT_NE(p.would_test.find("(0 of "), std::string::npos) << p.would_test;

  // About 3.1 rad the stretch leads through the direction backwards: 3.1 +- 0.354, by 1 - cos x = 0.09 ln 2.
  std::string astern = text;
  astern.replace(astern.find("exp("), std::string("exp(-((b - m)/w)^2)").size(), "exp((cos(b - m) - 1)/w^2)");
  astern.replace(astern.find("value: 2.0"), std::string("value: 2.0").size(), "value: 3.1");
  const auto behind = effect_from_formula(astern, "guard");
  const LawPrediction q = predict_law(*behind, stated_values(*behind), std::span(&recording, 1));
  double low = 0.0, high = 0.0;
  ASSERT_EQ(std::sscanf(q.would_test.c_str(), "readings with b from %lf to %lf rad", &low, &high), 2)
      << q.would_test;
  EXPECT_NEAR(low, 3.1 - 0.354, 0.03);
  EXPECT_NEAR(high, 3.1 + 0.354 - 2.0 * 3.14159265, 0.03);
}

TEST(Laws, WhatStandsForABumpInTheCatalogueIsCalledLessLikelyThanTheBump) {
  const double middle = 1.8, width = 0.2;
  const Diagnosis diagnosis = diagnosed(changed("Laws.Bump", 5, nothing, [&](double y, double) {
    return 0.015 * std::exp(-std::pow((y - middle) / width, 2));
  }));
  ASSERT_FALSE(diagnosis.final_effects.empty());
  EXPECT_NE(diagnosis.final_effects.front(), "generic") << "without a name there is nothing to doubt";
  ASSERT_FALSE(diagnosis.laws.empty());
  // A wide block that ends where the bump begins is as likely here: laws within a nat of the likeliest are not told apart.
  const double most = diagnosis.laws[0].log_evidence_over_curve;
  EXPECT_TRUE(std::any_of(diagnosis.laws.begin(), diagnosis.laws.end(), [&](const Law& law) {
    return law.log_evidence_over_curve > most - 1.0 && law.variables == std::vector<std::string>{"d"} &&
           std::abs(law.parameters[1].estimate - middle) < 0.1;
  })) << diagnosis.laws[0].formula;
  EXPECT_TRUE(std::any_of(diagnosis.notes.begin(), diagnosis.notes.end(), [](const std::string& note) {
    return note.starts_with("law_1 without any of these names is likelier than they are, by ");
  }));
}

TEST(Laws, TheRightNameIsNotDoubted) {
  // An eccentric ring is a ripple of order 1: a law says the same of it, and no more.
  const Diagnosis diagnosis = diagnosed(
      changed("Laws.Ring", 1, nothing, [](double, double b) { return amplitude * std::cos(b - 1.0); }));
  EXPECT_EQ(diagnosis.final_effects, std::vector<std::string>{"range_eccentricity"});
  EXPECT_TRUE(diagnosis.laws.empty());
}

TEST(Laws, OfACleanRecordingThereIsNone) {
  EXPECT_TRUE(laws_of(changed("Laws.Clean", 1, nothing, no_change)).empty());
}

TEST(Laws, EveryTermIsAFormulaThatCanBeRead) {
  // Of each channel, over a recording with times and columns of all kinds of units: names, units, starts and bounds hold.
  Recording recording = recording_of({.sigma = 0.004}, "Laws.Terms", 1);
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const double x = 0.01 * static_cast<double>(i % 700);
    recording.readings.time_s.push_back(static_cast<double>(i));
    recording.readings.covariates["temperature_c"].push_back(20.0 + x);
    recording.readings.covariates["speed_mps"].push_back(0.05 * x);
    recording.readings.covariates["rx_power_dbm"].push_back(x - 80.0);
    recording.readings.covariates["elevation_rad"].push_back(0.1 * x);
    recording.readings.covariates["anchor_azimuth_rad"].push_back(0.8 * x - 3.0);
  }
  const diagnosis::Rows rows = diagnosis::make_rows(std::span(&recording, 1));
  for (const char* channel : {"range", "bearing", "range_noise", "bearing_noise"}) {
    const std::vector<diagnosis::LawPiece> pieces = diagnosis::law_pieces(rows, channel, 3);
    EXPECT_GT(pieces.size(), 60u) << channel;
    const auto along = [&](const std::string& words) {
      return std::any_of(pieces.begin(), pieces.end(), [&](const auto& p) { return p.words == words; });
    };
    EXPECT_TRUE(along("a square along elevation_rad") && along("a ripple along elevation_rad"));
    EXPECT_TRUE(along("a ripple along anchor_azimuth_rad") && !along("a square along anchor_azimuth_rad"));
    for (const diagnosis::LawPiece& piece : pieces) {
      const std::string text = diagnosis::law_text({piece}, "law", channel);
      std::unique_ptr<Effect> effect;
      ASSERT_NO_THROW(effect = effect_from_formula(text, "law")) << text;
      EXPECT_EQ(effect->info().channel, channel);
      EXPECT_TRUE(effect->info().parameters.front().linear) << text;
    }
  }
}

}  // namespace
}  // namespace rangecal
