// SPDX-License-Identifier: BSD-3-Clause
// Readings that follow a recorded column are named with it.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

/// 500 readings y = 0.02 + 1.01 d + a (T - 20) / 10 + b (h - 50) / 20 + 0.003 y^2 e, d from 0.5 to 5 m, T from 5 to 35,
/// h from 20 to 80.
Recording with_columns(const std::string& name, double a, double b,
                       const std::string& column_of_h = "humidity_percent") {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = name;
  Random random(seed_from("DiagnosedColumns " + name));
  Pairs& pairs = recording.pairs;
  for (int i = 0; i < 500; ++i) {
    const double d = random.uniform(0.5, 5.0), T = random.uniform(5.0, 35.0), h = random.uniform(20.0, 80.0);
    const double f = 0.02 + 1.01 * d;
    pairs.true_m.push_back(d);
    pairs.reading_m.push_back(f + 0.1 * a * (T - 20.0) + 0.05 * b * (h - 50.0) +
                              random.normal(0.0, 0.003 * f * f));
    pairs.covariates["temperature_c"].push_back(T);
    pairs.covariates[column_of_h].push_back(h);
    pairs.row.push_back(i + 2);
  }
  return recording;
}

Diagnosis diagnosed(const Recording& recording) {
  DiagnoseOptions options;
  options.unseen = options.next_experiments = false;
  return diagnose({&recording, 1}, options);
}

double estimate_of(const Diagnosis& d, const std::string& name) {
  for (const EffectEstimate& e : d.explanations.at(0).parameters)
    if (e.name == name) return e.estimate;
  ADD_FAILURE() << "no parameter " << name;
  return std::nan("");
}

TEST(DiagnosedColumns, ATemperatureIsNamedByTheKelvin) {
  const Diagnosis d = diagnosed(with_columns("temperature", 0.04, 0.0));
  EXPECT_EQ(d.verdict, Verdict::explained);
  EXPECT_THAT(d.final_effects, ElementsAre("temperature_coefficient:temperature_c"));
  EXPECT_THAT(d.sentence, HasSubstr("Explained by temperature_coefficient along temperature_c"));
  // Standard error: the noise has 0.003 * 9 m^2 = 27 mm RMS, T a spread of 8.7 K, 500 readings: 0.14 mm/K; 4 of them.
  EXPECT_NEAR(estimate_of(d, "temperature_coefficient:temperature_c.offset_m_per_k"), 0.004, 6e-4);
  EXPECT_LT(*d.after.heldout_nll, *d.before.heldout_nll);
}

TEST(DiagnosedColumns, TwoColumnsAreTwoCauses) {
  const Recording recording = with_columns("two columns", 0.03, -0.04);
  const Diagnosis d = diagnosed(recording);
  EXPECT_EQ(d.verdict, Verdict::explained);
  EXPECT_THAT(d.final_effects, UnorderedElementsAre("temperature_coefficient:temperature_c",
                                                    "covariate_drift:humidity_percent"));
  // Per standard deviation of h, 60 / sqrt(12) = 17.3: -0.04 * 17.3 / 20.
  EXPECT_NEAR(estimate_of(d, "covariate_drift:humidity_percent.offset_m"), -0.0346, 0.006);
  const nlohmann::json json = nlohmann::json::parse(diagnosis_to_json(d));
  EXPECT_THAT(json["final"]["effects"], UnorderedElementsAre("temperature_coefficient", "covariate_drift"));
  EXPECT_TRUE(json["final"]["parameters"].contains("covariate_drift.offset_m"));
  std::vector<std::string> columns;
  for (const auto& member : json["final"]["members"]) columns.push_back(member["column"]);
  EXPECT_THAT(columns, UnorderedElementsAre("temperature_c", "humidity_percent"));
}

TEST(DiagnosedColumns, TwoOfAKindStandSideBySide) {
  Recording recording = with_columns("two of a kind", 0.03, -0.04);
  Covariates& columns = recording.pairs.covariates;
  columns["pressure_hpa"] = columns["temperature_c"];
  columns.erase("temperature_c");
  const Diagnosis d = diagnosed(recording);
  EXPECT_THAT(d.final_effects,
              UnorderedElementsAre("covariate_drift:pressure_hpa", "covariate_drift:humidity_percent"));
  const nlohmann::json json = nlohmann::json::parse(diagnosis_to_json(d));
  EXPECT_THAT(json["final"]["effects"], ElementsAre("covariate_drift", "covariate_drift"));
  EXPECT_TRUE(json["final"]["parameters"].contains("covariate_drift:pressure_hpa.offset_m"));
}

/// `count` readings y = d + a (T - 20) + sigma d^power e, d by `distance`, T from 10 to 30 and never the same twice.
template <typename Distance>
Recording warmed(const std::string& name, int count, double a, double sigma, const Distance& distance,
                 int power = 0) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = name;
  Random random(seed_from("DiagnosedColumns " + name));
  for (int i = 0; i < count; ++i) {
    const double d = distance(random), T = random.uniform(10.0, 30.0);
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(d + a * (T - 20.0) + random.normal(0.0, sigma * std::pow(d, power)));
    recording.pairs.covariates["temperature_c"].push_back(T);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

double to_a_centimetre(Random& random) { return 0.01 * std::round(random.uniform(30.0, 500.0)); }
double one_of_five(Random& random) { return 0.5 + std::floor(random.uniform(0.0, 5.0)); }

const char* const by_the_kelvin = "temperature_coefficient:temperature_c";

// Of 400 distances noted to a centimetre 150 come twice or more, in rows far apart, at other temperatures.
TEST(DiagnosedColumns, DistancesNotedToACentimetreAreNoRepeats) {
  for (const double sigma : {0.003, 0.006, 0.012}) {
    const Diagnosis d =
        diagnosed(warmed("centimetres " + std::to_string(sigma), 400, 0.001, sigma, to_a_centimetre));
    EXPECT_THAT(d.final_effects, ElementsAre(by_the_kelvin)) << sigma << ' ' << d.sentence;
    EXPECT_TRUE(d.after.heldout_nll) << sigma;
    // At the mean distance of 2.65 m, where offset and scale are independent.
    const double per_kelvin = estimate_of(d, std::string(by_the_kelvin) + ".offset_m_per_k") +
                              2.65 * estimate_of(d, std::string(by_the_kelvin) + ".scale_per_k");
    EXPECT_NEAR(per_kelvin, 0.001, 4.0 * sigma / 5.8 / 20.0) << sigma;
  }
}

// It moves with the reading's error, as what was computed from the reading would; but not with the distance.
// The law of the noise is that of what the temperature leaves of the repeats.
TEST(DiagnosedColumns, ATemperatureThatChangesBetweenRepeatsIsACause) {
  for (const auto& [sigma, power] : {std::pair(0.002, 0), {0.006, 0}, {0.0006, 2}}) {
    const Diagnosis d =
        diagnosed(warmed("repeats " + std::to_string(sigma), 300, 0.001, sigma, one_of_five, power));
    EXPECT_THAT(d.final_effects, ElementsAre(by_the_kelvin)) << sigma << ' ' << d.sentence;
  }
}

TEST(DiagnosedColumns, RowsThatWereCopiedAreLeftOut) {
  Recording recording =
      warmed("copied", 400, 0.0, 0.006, [](Random& random) { return random.uniform(0.3, 5.0); });
  Pairs& p = recording.pairs;
  for (std::size_t i = 0; i < 120; ++i) {
    p.true_m.push_back(p.true_m[2 * i]);
    p.reading_m.push_back(p.reading_m[2 * i]);
    p.covariates["temperature_c"].push_back(p.covariates["temperature_c"][2 * i]);
    p.row.push_back(static_cast<int>(402 + i));
  }
  const Diagnosis d = diagnosed(recording);
  EXPECT_EQ(d.verdict, Verdict::no_mismatch) << d.sentence;
  EXPECT_THAT(
      d.notes,
      Contains("left out, 120 row(s) that repeat another one in every column (the first in row 402)"));
  EXPECT_EQ(d.baseline.counts.used, recording.counts.used);
}

TEST(DiagnosedColumns, ReadingsWithoutATemperatureAreLeftOut) {
  Recording recording =
      warmed("incomplete", 450, 0.0015, 0.006, [](Random& random) { return random.uniform(0.3, 5.0); });
  for (std::size_t i = 0; i < 450; i += 15) recording.pairs.covariates["temperature_c"][i] = std::nan("");
  const Diagnosis d = diagnosed(recording);
  EXPECT_EQ(d.verdict, Verdict::explained) << d.sentence;
  EXPECT_THAT(d.final_effects, ElementsAre(by_the_kelvin));
  EXPECT_THAT(
      d.notes,
      Contains(
          "left out, 30 reading(s) that lack a value in a column that the others have (the first in row 2)"));

  for (std::size_t i = 0; i < 300; ++i) recording.pairs.covariates["temperature_c"][i] = std::nan("");
  EXPECT_THAT(diagnosed(recording).notes,
              Contains(HasSubstr("column temperature_c was not used: 310 of 450 readings lack it")));
}

// A curve of order 5 has no name; the calibration is that of the seed model, not what was fitted beside the curve for what is left.
TEST(DiagnosedColumns, ACurveWithoutANameLeavesTheCalibrationAsItWas) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "bent";
  Random random(seed_from("DiagnosedColumns bent"));
  for (int i = 0; i < 400; ++i) {
    const double d = random.uniform(0.3, 5.0), x = (d - 2.65) / 2.35;
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(d + 0.01 * (16.0 * x * x * x * x * x - 20.0 * x * x * x + 5.0 * x) +
                                        random.normal(0.0, 0.006));
    recording.pairs.row.push_back(i + 2);
  }
  const Diagnosis d = diagnosed(recording);
  EXPECT_EQ(d.verdict, Verdict::unexplained) << d.sentence;
  EXPECT_THAT(d.final_effects, ElementsAre("generic"));
  EXPECT_EQ(d.corrected.alpha, d.baseline.alpha);
  EXPECT_EQ(d.corrected.noise.parameters, d.baseline.noise.parameters);
}

TEST(DiagnosedColumns, ColumnsWithoutACauseStayQuiet) {
  const Diagnosis d = diagnosed(with_columns("quiet", 0.0, 0.0));
  EXPECT_EQ(d.verdict, Verdict::no_mismatch) << d.sentence;
}

TEST(DiagnosedColumns, ARoleStatedInTheRecordingDecides) {
  Recording recording = with_columns("stated", 0.0, 0.05, "T1");
  recording.columns["T1"] = {ColumnRole::received_power, "dB"};
  EXPECT_THAT(diagnosed(recording).final_effects, ElementsAre("power_bias:T1"));
}

TEST(DiagnosedColumns, TheColumnIsAskedForToUndoIt) {
  const Diagnosis d = diagnosed(with_columns("undone", 0.04, 0.0));
  const CsvTable table = CsvTable::parse("range_m,temperature_c\n2.06,30\n2.06,20\n2.06,\n", "readings.csv");
  const ReadingSettings settings = reading_settings(d.corrected, &table, "readings.csv", 3);
  const auto distance = [&](std::size_t row) {
    return correction_candidates(settings.corrector, 2.06, settings.of_reading[row], false).at(0);
  };
  // 10 K make 0.04 m of reading, that is 0.04 / 1.01 m; tolerance as above, 10 K * 0.6 mm/K
  EXPECT_NEAR(*distance(1).distance_m - *distance(0).distance_m, 0.0396, 0.006);
  EXPECT_EQ(distance(2).flag, "missing");
  const CsvTable bare = CsvTable::parse("range_m\n2.06\n", "bare.csv");
  EXPECT_THROW(reading_settings(d.corrected, &bare, "bare.csv", 1), InputError);
}

TEST(DiagnosedColumns, ReadingsRoundedToACentimetreAreAGrid) {
  // The noise is 0.8 mm at 0.5 m and 75 mm at 5 m: rounding hides that of a fifth of the readings.
  Recording recording = with_columns("rounded", 0.04, 0.0);
  for (double& reading : recording.pairs.reading_m) reading = std::round(100.0 * reading) / 100.0;
  EXPECT_THAT(diagnosed(recording).final_effects,
              UnorderedElementsAre("quantisation", "temperature_coefficient:temperature_c"));
  // To a tenth of a millimetre it hides nothing.
  recording = with_columns("rounded finely", 0.04, 0.0);
  for (double& reading : recording.pairs.reading_m) reading = std::round(1e4 * reading) / 1e4;
  EXPECT_THAT(diagnosed(recording).final_effects, ElementsAre("temperature_coefficient:temperature_c"));
}

TEST(DiagnosedColumns, WhatIsLargeIsSaidToBe) {
  const auto said = [](const Diagnosis& d) {
    return std::any_of(d.notes.begin(), d.notes.end(), [](const std::string& note) {
      return note.find("temperature_coefficient along temperature_c is unusually large") != std::string::npos;
    });
  };
  EXPECT_TRUE(said(diagnosed(with_columns("large", 0.3, 0.0))));     // 30 mm/K, 60 times the typical 0.5
  EXPECT_FALSE(said(diagnosed(with_columns("usual", 0.012, 0.0))));  // 1.2 mm/K
}

}  // namespace
}  // namespace rangecal
