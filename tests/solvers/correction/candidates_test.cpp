// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/candidates.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// f(d) = d between 0.5 and 4 m, 300 landmarks l0, l1, .. and 100 stops s0, s1, .. with headings 0, 0.01, ..
Calibration calibration_with(const std::string& effect, const std::map<std::string, double>& parameters) {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector2d(0.0, 1.0);
  c.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.001)};
  c.range_min_m = 0.5;
  c.range_max_m = 4.0;
  c.landmarks.resize(300);
  for (std::size_t l = 0; l < c.landmarks.size(); ++l) c.landmarks[l].label = fmt::format("l{}", l);
  for (int s = 0; s < 100; ++s) c.stops.push_back({0, fmt::format("s{}", s), {0.0, 0.0, 0.01 * s}});
  c.effects[effect] = parameters;
  return c;
}

Calibration warming() {
  return calibration_with("warmup_drift", {{"offset_m", 0.02}, {"curvature_per_m", 0.0}, {"time_s", 10.0}});
}

Calibration displaced() {
  return calibration_with("moved_landmark",
                          {{"x_m", 0.1}, {"y_m", 0.0}, {"landmark", 250.0}, {"stop", 40.0}});
}

std::vector<ReadingSetting> settings_of(const Calibration& calibration, const std::string& text) {
  const CsvTable table = CsvTable::parse(text, "readings.csv");
  return reading_settings(calibration, &table, "readings.csv", table.rows()).of_reading;
}

std::string setting_refusal(const Calibration& calibration, const std::string& text) {
  try {
    settings_of(calibration, text);
  } catch (const InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(ReadingSettings, LabelsBecomeNumbersOfTheCalibration) {
  const Calibration calibration = displaced();
  const std::vector<ReadingSetting> at =
      settings_of(calibration,
                  "range_m,bearing_rad,landmark,stop\n"
                  "1,0.1,l250,s40\n1,0.2,l299,s99\n1,0.3,elsewhere,s1\n1,0.4,,s1\n1,0.5,l1,\n1,,l1,s1\n");
  ASSERT_EQ(at.size(), 6u);
  EXPECT_EQ(at[0].landmark, 250);
  EXPECT_EQ(at[0].stop, 40);
  EXPECT_DOUBLE_EQ(at[0].heading_rad, 0.4);  // the stop's
  EXPECT_EQ(at[1].landmark, 299);
  EXPECT_EQ(at[1].stop, 99);
  EXPECT_EQ(at[2].landmark, -1);
  for (std::size_t i = 0; i < at.size(); ++i) EXPECT_EQ(at[i].complete, i < 3) << i;
}

// Without a column heading_rad the heading is the stop's: of a stop that the calibration does not know there is none.
TEST(ReadingSettings, AHeadingThatNobodyKnowsIsMissing) {
  const std::vector<ReadingSetting> at =
      settings_of(displaced(), "range_m,bearing_rad,landmark,stop\n1,0.1,l250,s40\n1,0.1,l250,unknown\n");
  EXPECT_TRUE(at[0].complete);
  EXPECT_FALSE(at[1].complete);
  const std::vector<ReadingSetting> own =
      settings_of(displaced(),
                  "range_m,bearing_rad,landmark,stop,heading_rad\n1,0.1,l250,unknown,0.5\n1,0.1,l250,s40,\n");
  EXPECT_TRUE(own[0].complete && own[1].complete);
  EXPECT_DOUBLE_EQ(own[1].heading_rad, 0.4);
}

TEST(ReadingSettings, TimesCountFromTheFirstAndAnEmptyOneIsMissing) {
  const std::vector<ReadingSetting> at =
      settings_of(warming(), "range_m,time_s\n1,\n1,105\n1,102.5\n1,inf\n");
  ASSERT_EQ(at.size(), 4u);
  EXPECT_FALSE(at[0].complete);
  EXPECT_DOUBLE_EQ(at[1].time_s, 2.5);
  EXPECT_DOUBLE_EQ(at[2].time_s, 0.0);
  EXPECT_FALSE(at[3].complete);
  EXPECT_THAT(setting_refusal(warming(), "range_m,time_s\n1,0\n1,late\n"),
              AllOf(HasSubstr("readings.csv, row 3, column 'time_s'"), HasSubstr("not a number")));
  EXPECT_THAT(setting_refusal(warming(), "range_m\n1\n"), HasSubstr("column 'time_s': is missing"));
}

TEST(ReadingSettings, WhatNoEffectNeedsMayBeEmptyOrText) {
  const Calibration offset =
      calibration_with("near_regime", {{"offset_m", 0.03}, {"slope", 0.0}, {"limit_m", 1.0}});
  for (const ReadingSetting& at : settings_of(
           offset, "range_m,time_s,bearing_rad,landmark,stop,repeat\n1,,,,,\n1,5,7,l1,s1,2\n1,,,,,\n"))
    EXPECT_TRUE(at.complete);
  EXPECT_TRUE(settings_of(offset, "range_m,time_s,repeat\n1,12:30:05,first\n")[0].complete);
}

TEST(ReadingSettings, ARepeatIsAWholeNumber) {
  EXPECT_EQ(settings_of(warming(), "range_m,time_s,repeat\n1,0,3\n1,0,\n")[0].repeat, 3);
  for (const char* repeat : {"1e12", "1.5", "-1"})
    EXPECT_THAT(setting_refusal(warming(), std::string("range_m,time_s,repeat\n1,0,0\n1,0,") + repeat + "\n"),
                AllOf(HasSubstr("readings.csv, row 3, column 'repeat'"), HasSubstr(repeat)));
}

// Bearings of 170 to -170 degrees (2.967, -2.967 rad) were fitted, by way of 180.
TEST(ReadingSettings, ValuesBeyondThoseFittedAreMarked) {
  Calibration turning = calibration_with("range_eccentricity", {{"cosine_m", 0.02}, {"sine_m", 0.0}});
  turning.effects_range["bearing_rad"] = {2.967, -2.967};
  const CsvTable bearings =
      CsvTable::parse("range_m,bearing_rad\n1,3.0\n1,-3.1\n1,0.1\n1,3.3\n1,-2.9\n1,\n", "b.csv");
  const ReadingSettings at = reading_settings(turning, &bearings, "b.csv", bearings.rows());
  const std::vector<bool> beyond{false, false, true, false, true, false};  // 3.3 - 2 pi = -2.983
  for (std::size_t i = 0; i < beyond.size(); ++i)
    EXPECT_EQ(at.of_reading[i].extrapolated_column, beyond[i]) << i;
  ASSERT_EQ(at.beyond.size(), 1u);
  EXPECT_EQ(at.beyond[0].column, "bearing_rad");
  EXPECT_EQ(at.beyond[0].readings, 2u);
  EXPECT_EQ(at.beyond[0].first_row, 4);

  Calibration drifting = warming();  // times count from the first of the table, as in the fit
  drifting.effects_range["time_s"] = {0.0, 60.0};
  const std::vector<ReadingSetting> times = [&] {
    const CsvTable table = CsvTable::parse("range_m,time_s\n1,1000\n1,1060\n1,1060.5\n", "t.csv");
    return reading_settings(drifting, &table, "t.csv", table.rows()).of_reading;
  }();
  EXPECT_FALSE(times[0].extrapolated_column || times[1].extrapolated_column);
  EXPECT_TRUE(times[2].extrapolated_column);
}

std::vector<std::string> columns_needed(const Calibration& calibration,
                                        const std::vector<std::string>& covariates) {
  std::vector<std::string> columns;
  for (const EffectCorrector::Need& need : EffectCorrector(calibration, covariates).needs())
    columns.push_back(need.column);
  return columns;
}

TEST(EffectCorrector, NeedsTheColumnsThatChangeAnyReading) {
  EXPECT_THAT(columns_needed(displaced(), {}), ElementsAre("bearing_rad", "heading_rad", "landmark", "stop"));
  EXPECT_THAT(columns_needed(warming(), {"humidity"}), ElementsAre("time_s"));
  const Calibration expanding = calibration_with("range_scale", {{"scale", 0.01}, {"form", 1.0}});
  EXPECT_THAT(columns_needed(expanding, {}), ElementsAre("temperature_c"));
  EXPECT_THAT(columns_needed(expanding, {"humidity", "temperature_c"}), ElementsAre("temperature_c"));
}

template <typename Given>
concept MakesACorrector = std::is_constructible_v<EffectCorrector, Given, std::vector<std::string>>;
template <typename Given>
concept MakesSettings = requires(Given&& given) {
  reading_settings(std::forward<Given>(given), nullptr, "", std::size_t{0});
};

// They keep a reference.
static_assert(MakesACorrector<Calibration&> && MakesACorrector<const Calibration&>);
static_assert(!MakesACorrector<Calibration> && !MakesACorrector<const Calibration>);
static_assert(MakesSettings<const Calibration&> && !MakesSettings<Calibration> &&
              !MakesSettings<const Calibration>);

}  // namespace
}  // namespace rangecal
