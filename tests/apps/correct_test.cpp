// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"

namespace rangecal::test {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

/// f(d) = 0.1 + 0.5 d over 0.5 to 4 m, s = 1 cm, alpha exact.
Calibration line() {
  Calibration calibration;
  calibration.outcome = Outcome::converged;
  calibration.alpha = Eigen::Vector2d(0.1, 0.5);
  calibration.noise.law = NoiseLaw::constant;
  calibration.noise.parameters = Eigen::VectorXd::Constant(1, 0.01);
  calibration.range_min_m = 0.5;
  calibration.range_max_m = 4.0;
  return calibration;
}

class CorrectCommand : public ::testing::Test {
 protected:
  std::string save(const Calibration& calibration) {
    save_calibrations({calibration}, folder.file("cal.json"));
    return folder.file("cal.json");
  }
  TemporaryFolder folder;
};

TEST_F(CorrectCommand, OnePerLineFromStdin) {
  // d = (y - 0.1) / 0.5: 1.1 -> 2, 0.6 -> 1; its standard deviation 0.01 / 0.5 = 0.02.
  const RunResult result = run("correct " + save(line()), "1.1\n\n 0.6 \r\n");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.out,
            "reading_m,distance_m,std_m,candidate,flag\n"
            "1.1,2.000000,0.020000,1,ok\n"
            "0.6,1.000000,0.020000,1,ok\n");
}

TEST_F(CorrectCommand, CsvByColumnName) {
  folder.write("a.csv", "stop,range_m\n0,1.1\n1,\n2,0\n3,-1\n");
  const RunResult result = run("correct " + save(line()) + " " + folder.file("a.csv"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.out,
            "reading_m,distance_m,std_m,candidate,flag\n"
            "1.1,2.000000,0.020000,1,ok\n"
            ",,,,missing\n"
            "0,,,,zero\n"
            "-1,,,,negative\n");
  folder.write("b.csv", "reading_m,range_m\n0.6,1.1\n");  // reading_m goes first
  EXPECT_THAT(run("correct " + save(line()) + " " + folder.file("b.csv")).out, HasSubstr("0.6,1.000000"));
}

TEST_F(CorrectCommand, EveryPlausibleRootIsListed) {
  // f(d) = 2 - 2 d + d^2 = 1 + (d - 1)^2 is 1.25 at d = 0.5 and at d = 1.5.
  Calibration bowl = line();
  bowl.alpha = Eigen::Vector3d(2.0, -2.0, 1.0);
  bowl.range_min_m = 0.2;
  bowl.range_max_m = 3.0;
  const RunResult result = run("correct " + save(bowl), "1.25\n");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("1.25,0.500000,0.010000,"));
  EXPECT_THAT(result.out, HasSubstr("1.25,1.500000,0.010000,"));
  EXPECT_EQ(count_of(result.out, "ambiguous"), 2);
}

TEST_F(CorrectCommand, OutOfRangeIsFlagged) {
  // Fitted to 4 m, sought to 4 + 0.1 * 3.5 m: 2.2 stands for d = 4.2 (extrapolated), 9 for none.
  const RunResult result = run("correct " + save(line()), "2.2\n9\n");
  EXPECT_THAT(result.out, HasSubstr("2.2,4.200000,0.020000,1,extrapolated\n"));
  EXPECT_THAT(result.out, HasSubstr("9,,,,out_of_range\n"));
}

TEST_F(CorrectCommand, WhatNoDistanceExplainsHasNone) {
  // f(4.35) = 2.275 at the far end that is sought, s = 1 cm: 2.3 is 2.5 standard deviations off, 2.32 is 4.5. At the near
  // end, 0.15 m, f = 0.175.
  const std::string json = save(line());
  const std::string sentinels = "1e-9\n0.13\n2.32\n65.535\n65535\n1e38\n1e300\n";
  for (const std::string roots : {"ls", "ml"}) {
    const RunResult result = run("correct " + json + " --roots " + roots, sentinels);
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(count_of(result.out, ",,,,out_of_range\n"), 7) << result.out;
  }
  EXPECT_THAT(run("correct " + json, "2.3\n0.16\n").out,
              AllOf(HasSubstr("2.3,4.350000,0.020000,1,out_of_range\n"),
                    HasSubstr("0.16,0.150000,0.020000,1,out_of_range\n")));
  EXPECT_EQ(count_of(run("correct " + json + " --prior uniform", sentinels).out, ",,,,out_of_range,,,,,\n"),
            7);
  EXPECT_EQ(count_of(run("correct " + json, "0\n-0\n-1e38\n").out, ",,,,negative\n"), 1);
  // with an effect, and with noise that grows: a law that is squared before it is compared overflows first
  Calibration growing = line();
  growing.noise = {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.001)};
  growing.effects["range_offset"] = {{"offset_m", 0.01}};
  for (const bool effects : {true, false}) {
    if (!effects) growing.effects.clear();
    for (const std::string how : {"", " --roots ml", " --prior uniform"})
      EXPECT_EQ(count_of(run("correct " + save(growing) + how, sentinels).out, ",,,,out_of_range"), 7)
          << how << " effects " << effects;
  }
}

TEST_F(CorrectCommand, SaysOnceWhereItTakesEffectsAsExact) {
  // y = 0.1 + 0.5 d + 0.1: 1.2 stands for 2 m; var g = 0.003^2 of the offset beside s = 0.01: sqrt(1.09e-4) / 0.5.
  Calibration calibration = line();
  calibration.effects["range_offset"] = {{"offset_m", 0.1}};
  const RunResult exact = run("correct " + save(calibration), "1.2\n1.2\n");
  EXPECT_EQ(count_of(exact.err, "how well its effects are known"), 1) << exact.err;
  EXPECT_THAT(exact.out, HasSubstr("1.2,2.000000,0.020000,1,ok\n"));
  EffectsCovariance known{{"range_offset.offset_m"}, Eigen::MatrixXd::Zero(3, 3)};
  known.matrix(2, 2) = 9e-6;
  calibration.effects_covariance = known;
  const RunResult told = run("correct " + save(calibration), "1.2\n");
  EXPECT_EQ(told.err, "");
  EXPECT_THAT(told.out, HasSubstr("1.2,2.000000,0.020881,1,ok\n"));
  EXPECT_EQ(run("correct " + save(line()), "1.2\n").err, "");
}

TEST_F(CorrectCommand, FlagsThatHoldTogetherAreJoined) {
  // f = 1 + (d - 1)^2 fitted on 0.6 to 3: 1.25 at 1.5 and at 0.5, which is 0.1 m nearer than any distance fitted.
  Calibration bowl = line();
  bowl.alpha = Eigen::Vector3d(2.0, -2.0, 1.0);
  bowl.range_min_m = 0.6;
  bowl.range_max_m = 3.0;
  const std::string json = save(bowl);
  const RunResult plain = run("correct " + json, "1.25\n");
  EXPECT_EQ(count_of(plain.out, ",ambiguous+extrapolated\n"), 1) << plain.out;
  EXPECT_EQ(count_of(plain.out, ",ambiguous\n"), 1) << plain.out;
  const RunResult posterior = run("correct " + json + " --prior uniform --limits 0.2 3", "1.25\n");
  EXPECT_EQ(count_of(posterior.out, ",ambiguous+extrapolated,"), 1) << posterior.out;
  EXPECT_EQ(count_of(posterior.out, ",ambiguous,"), 1) << posterior.out;
}

TEST_F(CorrectCommand, ADistanceBeyondTheFitIsFlaggedUnderAPriorToo) {
  // f(3) = 1.6, f(9) = 4.6, f(25) = 12.6; the fit ends at 4 m, the prior at 20 m.
  const RunResult far =
      run("correct " + save(line()) + " --prior uniform --limits 0.2 20", "1.6\n4.6\n12.6\n");
  ASSERT_EQ(far.code, 0) << far.err;
  EXPECT_EQ(count_of(far.out, ",1,ok,"), 1) << far.out;
  EXPECT_EQ(count_of(far.out, "4.6,9.000000,0.020000,1,extrapolated,"), 1) << far.out;
  EXPECT_THAT(far.out, HasSubstr("12.6,,,,out_of_range"));
  // by the table, which takes over from 20 000 readings on
  std::string many;
  for (int i = 0; i < 20000; ++i) many += i % 2 ? "1.6\n" : "4.6\n";
  const RunResult table = run("correct " + save(line()) + " --prior uniform --limits 0.2 20", many);
  EXPECT_EQ(count_of(table.out, ",1,extrapolated,"), 10000);
  EXPECT_EQ(count_of(table.out, ",1,ok,"), 10000);
}

TEST_F(CorrectCommand, MalformedLinesNameTheRow) {
  const std::string json = save(line());
  const RunResult text = run("correct " + json, "1.1\n1.2 m\n");
  EXPECT_EQ(text.code, 2);
  EXPECT_THAT(text.err, HasSubstr("stdin, row 2"));
  EXPECT_EQ(text.out, "");
  folder.write("a.csv", "reading_m\n1.1\nfar\n");
  const RunResult csv = run("correct " + json + " " + folder.file("a.csv"));
  EXPECT_EQ(csv.code, 2);
  EXPECT_THAT(csv.err, HasSubstr("a.csv, row 3, column 'reading_m'"));
  EXPECT_EQ(run("correct " + json, "").code, 2);
  EXPECT_EQ(run("correct " + json, "distance\n1.1\n").code, 2);
  EXPECT_EQ(run("correct " + json + " --roots all", "1.1\n").code, 2);
}

TEST_F(CorrectCommand, RefusesWhatIsNoCalibration) {
  folder.write("cal.json", "{\"format\": ");
  EXPECT_EQ(run("correct " + folder.file("cal.json"), "1.1\n").code, 2);
  Calibration unbounded = line();
  unbounded.outcome = Outcome::unbounded;
  const RunResult result = run("correct " + save(unbounded), "1.1\n");
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("unbounded"));
}

TEST_F(CorrectCommand, PosteriorSaysHowProbableEachRootIs) {
  // f = 1 + (d - 1)^2 on 0.2 to 3: 1.25 at 0.5 and 1.5, |f'| = 1 at both: one half each. s = 1 cm: std about 0.01.
  Calibration bowl = line();
  bowl.alpha = Eigen::Vector3d(2.0, -2.0, 1.0);
  bowl.range_min_m = 0.2;
  bowl.range_max_m = 3.0;
  const std::string json = save(bowl);
  const RunResult flat = run("correct " + json + " --prior uniform", "1.25\n0\n");
  ASSERT_EQ(flat.code, 0) << flat.err;
  EXPECT_THAT(
      flat.out,
      HasSubstr("reading_m,distance_m,std_m,candidate,flag,probability,mode_m,mean_m,low95_m,high95_m\n"));
  EXPECT_EQ(count_of(flat.out, ",ambiguous,0.5000,"), 2) << flat.out;
  EXPECT_THAT(flat.out, HasSubstr("0,,,,zero,,,,,\n"));
  EXPECT_EQ(
      count_of(run("correct " + json + " --prior uniform --limits 1.1 3", "1.25\n").out, ",ok,1.0000,1.5"),
      1);
  folder.write("map.csv", "reading_m,prior_m,prior_sigma_m\n1.25,0.6,0.1\n1.25,,\n");
  const RunResult map = run("correct " + json + " " + folder.file("map.csv") + " --prior map");
  EXPECT_EQ(count_of(map.out, "ambiguous"), 2) << map.out;
  EXPECT_EQ(count_of(map.out, ",1,ok,1.0000,"), 1) << map.out;
  // from f(2.8) = 4.24, which only 2.8 m explains, to 1.25 within 3 s at most 0.5 m/s: 1.5 m, not 0.5 m
  folder.write("motion.csv", "reading_m,time_s\n4.24,0\n1.25,3\n");
  const RunResult motion =
      run("correct " + json + " " + folder.file("motion.csv") + " --prior motion --speed 0.5");
  EXPECT_EQ(count_of(motion.out, ",1,ok,"), 2) << motion.out;
  EXPECT_EQ(run("correct " + json + " --prior map", "1.25\n").code, 2);
  // a bad row after good ones: none of them is printed
  for (const auto& [arguments, rows] :
       {std::pair<std::string, std::string>{"map",
                                            "reading_m,prior_m,prior_sigma_m\n1.25,1.0,0.1\n1.25,1.0,-0.1\n"},
        {"motion --speed 0.5", "reading_m,time_s\n1.25,0.0\n1.25,1.0\n1.25,0.5\n"}}) {
    const RunResult bad = run("correct " + json + " --prior " + arguments, rows);
    EXPECT_EQ(bad.code, 2) << arguments;
    EXPECT_EQ(bad.out, "") << arguments;
    EXPECT_EQ(count_of(bad.err, "\n"), 1) << bad.err;
  }
  EXPECT_EQ(run("correct " + json + " --prior motion " + folder.file("motion.csv")).code, 2);
  EXPECT_EQ(run("correct " + json + " --prior best", "1.25\n").code, 2);
  EXPECT_EQ(run("correct " + json + " --speed 1", "1.25\n").code, 2);
}

TEST_F(CorrectCommand, TakesWhatCalibrateWrote) {
  const std::string json = folder.file("cal.json");
  ASSERT_EQ(run("calibrate " + shipped("pairs-2016") + " --json " + json).code, 0);
  for (const std::string roots : {"ls", "ml"}) {
    // f(2) = 0.0525 + 2 * 0.8838 + 4 * 0.0584 = 2.0537; the fit knows it to a few mm.
    const RunResult result = run("correct " + json + " --roots " + roots, "2.0537\n");
    ASSERT_EQ(result.code, 0) << result.err;
    const std::size_t comma = result.out.find("2.0537,") + 7;
    EXPECT_NEAR(std::stod(result.out.substr(comma)), 2.0, 0.02) << result.out;
  }
}

TEST_F(CorrectCommand, ManyReadingsUnderOnePriorAreThoseOfTheIntegrals) {
  // f = 2 d - d^2 / 4 turns at 4: 30 000 readings, by the table; each fiftieth again by itself, by integrals. Up to 1e-3
  // standard deviations apart, 1e-3 in probability, and half a unit of the last digit printed.
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector3d(0.0, 2.0, -0.25);
  c.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.03)};
  c.range_min_m = 0.5;
  c.range_max_m = 7.0;
  save_calibrations({c}, folder.file("cal.json"));
  std::string many, few;
  for (int i = 0; i < 30000; ++i) {
    const std::string reading = fmt::format("{:.4f}\n", i == 100 ? 4.16 : 0.8 + 3.3 * i / 30000.0);
    many += reading;
    if (i % 50 == 0) few += reading;
  }
  folder.write("many.txt", many);
  folder.write("few.txt", few);
  std::map<std::string, std::vector<double>> exact;
  const auto lines = [&](const std::string& file, auto&& each) {
    const RunResult result =
        run("correct " + folder.file("cal.json") + " " + folder.file(file) + " --prior uniform");
    EXPECT_EQ(result.code, 0) << result.err;
    std::istringstream text(result.out);
    std::string line, field;
    std::getline(text, line);
    while (std::getline(text, line)) {
      std::vector<double> numbers;
      std::istringstream row(line);
      while (std::getline(row, field, ',')) numbers.push_back(std::strtod(field.c_str(), nullptr));
      each(line.substr(0, line.find(',')) + (numbers[1] < 4.0 ? " near" : " far"), numbers);
    }
  };
  lines("few.txt",
        [&](const std::string& name, const std::vector<double>& numbers) { exact[name] = numbers; });
  EXPECT_GT(exact.size(), 700u);
  std::size_t compared = 0;
  lines("many.txt", [&](const std::string& name, const std::vector<double>& numbers) {
    const auto found = exact.find(name);
    if (found == exact.end()) return;
    ++compared;
    const std::vector<double>& right = found->second;
    ASSERT_EQ(numbers.size(), right.size());
    if (right.size() < 10) return;                        // no distance: the fields behind the flag are empty
    for (const std::size_t i : {1u, 2u, 6u, 7u, 8u, 9u})  // spread of the whole: (high - low) / 3.92
      EXPECT_NEAR(numbers[i], right[i], 1.5e-3 * (right[9] - right[8]) / 3.9 + 2e-6)
          << name << " column " << i;
    EXPECT_NEAR(numbers[5], right[5], 1.2e-3) << name;
  });
  EXPECT_GE(compared, exact.size());
}

TEST_F(CorrectCommand, AnEmptyFieldThatAnEffectNeedsIsNotTakenForZero) {
  Calibration calibration = line();
  calibration.effects["range_eccentricity"] = {{"cosine_m", 0.02}, {"sine_m", 0.0}};
  const std::string json = save(calibration);
  const RunResult result = run("correct " + json, "range_m,bearing_rad\n1.1,\n1.1,nan\n1.1,0\n");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(count_of(result.out, "1.1,,,,missing\n"), 2) << result.out;
  EXPECT_EQ(count_of(result.out, ",ok"), 1) << result.out;
  const RunResult degrees = run("correct " + json, "range_m,bearing_rad\n1.1,0.5\n1.1,90\n");
  EXPECT_EQ(degrees.code, 2);
  EXPECT_THAT(degrees.err, HasSubstr("row 3, column 'bearing_rad'"));
  EXPECT_THAT(degrees.err, HasSubstr("radians"));
}

TEST_F(CorrectCommand, AColumnBeyondWhatTheEffectsWereFittedOverIsFlaggedAndCounted) {
  // y = 0.1 + 0.5 d + 0.01 (T - 20) / 10 d: at 20 C 1.1 is 2 m and 2.2 is 4.2 m, at 35 C 2.2 is 2.1 / 0.515 = 4.0777 m.
  Calibration calibration = line();
  calibration.effects["range_scale"] = {{"scale", 0.01}, {"form", 1.0}};
  calibration.effects_range["temperature_c"] = {10.0, 30.0};
  const std::string json = save(calibration);
  folder.write("r.csv", "range_m,temperature_c\n1.1,20\n1.1,30\n1.1,30.01\n2.2,20\n2.2,35\n1.1,\n9,9\n");
  const std::string command = "correct " + json + " " + folder.file("r.csv");
  const RunResult result = run(command);
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("1.1,2.000000,0.020000,1,ok\n"));
  EXPECT_THAT(result.out, HasSubstr("2.2,4.200000,0.020000,1,extrapolated\n"));
  EXPECT_THAT(result.out, HasSubstr("2.2,4.077670,0.019417,1,extrapolated+extrapolated_column\n"));
  EXPECT_EQ(count_of(result.out, ",ok\n"), 2) << result.out;
  EXPECT_EQ(count_of(result.out, "1,extrapolated_column\n"), 1) << result.out;
  EXPECT_EQ(count_of(result.out, ",,,,missing\n"), 1) << result.out;
  EXPECT_EQ(count_of(result.out, ",,,,out_of_range\n"), 1) << result.out;
  EXPECT_EQ(
      result.err,
      "rangecal: warning: " + json +
          ": does not say how well its effects are known, so std_m lacks their uncertainty\n"
          "rangecal: 2 of 7 readings are flagged extrapolated: at distances outside the 0.5 to 4 m of the fit\n"
          "rangecal: 1 of 7 readings are flagged out_of_range: read at no distance of the fit, nor near its ends\n"
          "rangecal: 3 of 7 readings have a temperature_c outside the 10 to 30 over which the effects that use it "
          "were fitted, first in row 4: extrapolated_column\n");
  const RunResult prior = run(command + " --prior uniform --limits 0.2 6");
  EXPECT_EQ(count_of(prior.out, ",1,extrapolated_column,"), 1) << prior.out;
  EXPECT_EQ(count_of(prior.out, ",1,extrapolated+extrapolated_column,"), 1) << prior.out;
  EXPECT_THAT(prior.err, HasSubstr("2 of 7 readings are flagged extrapolated: "));
  // a column that no effect uses has no range; a file of before these ranges says nothing of any
  calibration.effects_range = {{"humidity", {0.1, 0.2}}};
  const RunResult old = run("correct " + save(calibration) + " " + folder.file("r.csv"));
  EXPECT_EQ(old.code, 0) << old.err;
  EXPECT_EQ(count_of(old.out + old.err, "extrapolated_column"), 0) << old.err;
  // the column itself may not be missing
  const RunResult without = run("correct " + json, "range_m\n1.1\n");
  EXPECT_EQ(without.code, 2);
  EXPECT_EQ(without.out, "");
  EXPECT_THAT(without.err,
              HasSubstr("column 'temperature_c': is missing: the calibration's effect range_scale needs it"));
}

TEST_F(CorrectCommand, SaysThatAnEffectOnALandmarkWithoutALabelIsNotUndone) {
  Calibration calibration = line();
  calibration.kind = RecordingKind::pairs;  // lists no landmarks
  calibration.effects["target_reflectance"] = {{"amplitude_m", 0.03}, {"landmark", 1.0}, {"power", 0.0}};
  const RunResult unlisted = run("correct " + save(calibration), "range_m,landmark\n1.1,B\n");
  EXPECT_THAT(unlisted.err,
              HasSubstr("its effect target_reflectance is on one landmark whose label it does not hold"));
  EXPECT_THAT(unlisted.out, HasSubstr("1.1,2.000000,"));
  calibration.landmarks = {{0, "A", {0.0, 0.0}, std::nullopt}, {0, "B", {0.0, 0.0}, std::nullopt}};
  const RunResult listed = run("correct " + save(calibration), "range_m,landmark\n1.1,B\n");
  EXPECT_EQ(count_of(listed.err, "whose label"), 0) << listed.err;
  EXPECT_THAT(listed.out, HasSubstr("1.1,1.940000,"));  // (1.1 - 0.03 - 0.1) / 0.5
}

/// line(), and the second device reads 3 cm more than the first.
Calibration two_devices(const std::string& first, const std::string& second) {
  Calibration calibration = line();
  calibration.kind = RecordingKind::pairs;
  calibration.labels = {first, second};
  auto& offsets = calibration.effects["device_offset"];
  for (int l = 1; l <= 12; ++l) offsets["offset_" + std::to_string(l) + "_m"] = l == 1 ? 0.03 : 0.0;
  return calibration;
}

TEST_F(CorrectCommand, ADeviceThatTheCalibrationDoesNotKnowIsFlagged) {
  Calibration calibration = two_devices("A", "B");
  const std::string json = save(calibration);
  const RunResult result = run("correct " + json, "range_m,landmark\n1.1,A\n1.1,B\n1.1,C\n1.1,D\n");
  EXPECT_EQ(
      result.out,
      "reading_m,distance_m,std_m,candidate,flag\n1.1,2.000000,0.020000,1,ok\n1.1,1.940000,0.020000,1,ok\n"
      "1.1,2.000000,0.020000,1,extrapolated_column\n1.1,2.000000,0.020000,1,extrapolated_column\n");
  EXPECT_THAT(result.err,
              HasSubstr("rangecal: 2 of 4 readings are of a landmark or device that the calibration does not "
                        "know, first 'C' in row 4; it knows A, B: extrapolated_column\n"));
  // An effect on one landmark says of every other that it does nothing there.
  calibration.effects = {{"target_reflectance", {{"amplitude_m", 0.03}, {"landmark", 1.0}, {"power", 0.0}}}};
  const RunResult one = run("correct " + save(calibration), "range_m,landmark\n1.1,C\n");
  EXPECT_THAT(one.out, HasSubstr("1.1,2.000000,0.020000,1,ok\n"));
}

TEST_F(CorrectCommand, NamesAllColumnsThatAreMissing) {
  Calibration calibration = two_devices("A", "B");
  calibration.effects["range_scale"] = {{"scale", 0.01}, {"form", 1.0}};
  const RunResult result = run("correct " + save(calibration), "range_m\n1.1\n");
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(
      result.err,
      HasSubstr("column 'landmark': is missing: the calibration's effect device_offset needs it to be "
                "undone; so is 'temperature_c' for range_scale"));
}

TEST_F(CorrectCommand, SaysThatOutliersAreNotKnown) {
  Calibration calibration = line();
  calibration.effects["late_return"] = {{"share", 0.04}, {"excess_m", 0.3}};
  const RunResult result = run("correct " + save(calibration), "1.1\n");
  EXPECT_THAT(
      result.err,
      HasSubstr("it found outliers (late_return) in 4 % of its readings; which ones here are such is not "
                "known, and std_m is that of the others\n"));
}

TEST_F(CorrectCommand, YourOwnTableKeepsItsRowsAndColumns) {
  // As a spreadsheet of a language with decimal commas writes it; f(d) = 0.1 + 0.5 d, so 1100 mm is 2 m.
  const std::string json = save(two_devices("links", "rechts; neu"));
  folder.write(
      "log.csv",
      "sep=;\r\nZeit;roh [mm];Sensor;Notiz\r\n2024-05-01T12:00:00;1100;links;\"gut, \"\"sehr\"\"\"\r\n"
      ";;;\r\n12:01;600,5;\"rechts; neu\";\r\n;;links;\r\n;1100;;\r\n");
  const std::string command =
      "correct " + json + " " + folder.file("log.csv") + " --reading 'roh [mm]' --landmark Sensor";
  const RunResult kept = run(command + " --keep");
  ASSERT_EQ(kept.code, 0) << kept.err;
  EXPECT_EQ(kept.out,
            "Zeit;roh [mm];Sensor;Notiz;distance_m;std_m;flag\n"
            "2024-05-01T12:00:00;1100;links;\"gut, \"\"sehr\"\"\";2,000000;0,020000;ok\n"
            "12:01;600,5;\"rechts; neu\";;0,941000;0,020000;ok\n"
            ";;links;;;;missing\n"
            ";1100;;;;;missing\n");
  EXPECT_THAT(kept.err, HasSubstr("the reading is column 'roh [mm]', in mm, by its name; landmark is column "
                                  "'Sensor'\n"));
  const RunResult alone = run(command);
  EXPECT_EQ(
      alone.out,
      "reading_m,distance_m,std_m,candidate,flag\n1.1,2.000000,0.020000,1,ok\n0.6005,0.941000,0.020000,1,ok\n"
      ",,,,missing\n1.1,,,,missing\n");
}

TEST_F(CorrectCommand, AKeptRowHasItsMostLikelyDistanceAlone) {
  // f(d) = 1 + (d - 1)^2 is 1.25 at 0.5 and at 1.5 m.
  Calibration bowl = line();
  bowl.alpha = Eigen::Vector3d(2.0, -2.0, 1.0);
  bowl.range_min_m = 0.2, bowl.range_max_m = 3.0;
  const std::string json = save(bowl), table = "who,range_m,distance_m\nme,1.25,7\nyou,1.16,8\n";
  const RunResult all = run("correct " + json, table), kept = run("correct " + json + " --keep", table);
  ASSERT_EQ(kept.code, 0) << kept.err;
  EXPECT_EQ(count_of(all.out, "ambiguous"), 4) << all.out;
  EXPECT_THAT(kept.out, HasSubstr("who,range_m,distance_m,distance_m_corrected,std_m,flag\nme,1.25,7,"));
  EXPECT_EQ(count_of(kept.out, "\n"), 3) << kept.out;
  const std::string first = all.out.substr(all.out.find("1.25,") + 5, 17);  // distance_m,std_m
  EXPECT_THAT(kept.out, HasSubstr("me,1.25,7," + first + ",ambiguous\n"));
  const RunResult prior =
      run("correct " + json + " --keep --prior map", "raw_mm,prior_m,prior_sigma_m\n1250,1.5,0.05\n");
  EXPECT_THAT(prior.out,
              HasSubstr("raw_mm,prior_m,prior_sigma_m,distance_m,std_m,flag,probability,mode_m,mean_m,"
                        "low95_m,high95_m\n1250,1.5,0.05,1.4997"));
  EXPECT_EQ(count_of(prior.out, "\n"), 2) << prior.out;
}

TEST_F(CorrectCommand, YourOwnTableIsReadAsImportReadsIt) {
  Calibration calibration = line();
  calibration.effects["range_scale"] = {{"scale", 0.01}, {"form", 1.0}};  // with temperature_c
  const std::string json = save(calibration);
  // At 20 C 1.1 is 2 m; a number with a sign, an error of a spreadsheet, a column whose name means something else in a recording.
  const RunResult result = run("correct " + json + " --reading sonar --unit cm",
                               "sonar,temperature_c,time_s,stop\n+110,+20,late,a\n110,#N/A,,b\n");
  EXPECT_EQ(result.out,
            "reading_m,distance_m,std_m,candidate,flag\n1.1,2.000000,0.020000,1,ok\n1.1,,,,missing\n")
      << result.err;
  const auto refused = [&](const std::string& options, const std::string& table, const std::string& what) {
    const RunResult run_result = run("correct " + json + " " + options, table);
    EXPECT_EQ(run_result.code, 2) << table;
    EXPECT_EQ(run_result.out, "") << table;
    EXPECT_THAT(run_result.err, HasSubstr(what)) << table;
  };
  refused("--reading sonnar", "sonar,temperature_c\n1,20\n",
          "there is no column 'sonnar', did you mean 'sonar'?; the columns are 'sonar', 'temperature_c'");
  refused("--unit cm", "sonar,temperature_c\n1,20\n", "which column is the reading? say --reading COLUMN");
  refused("--reading sonar", "sonar,temperature_c\n1,20\nx,20\n",
          "row 3, column 'sonar': 'x' is not a number");
  refused("--reading sonar --skip 2", "made by me\n\nsonar,temperature_c\n1,20\n\n1,warm\n",
          "row 6, column 'temperature_c': 'warm' is not a number");
  // a decimal comma, or one between thousands?
  refused("--reading sonar", "sonar,temperature_c\n1,\"1,234\"\n",
          "row 2, column 'temperature_c': '1,234' is not a number");
  refused("--keep", "1.1\n1.2\n", "holds numbers where the columns' names are expected");
  refused("", "sonar,temperature_c\n1,20\n", "say --reading COLUMN");
}

TEST_F(CorrectCommand, ATextInAColumnThatAnEffectNeedsIsNamed) {
  Calibration calibration = line();
  calibration.effects["range_eccentricity"] = {{"cosine_m", 0.02}, {"sine_m", 0.0}};
  calibration.effects["range_scale"] = {{"scale", 0.01}, {"form", 1.0}};  // with temperature_c
  const std::string json = save(calibration), head = "range_m,bearing_rad,temperature_c,by\n1.1,0.5,20,me\n";
  const auto says = [&](const std::string& row, const std::string& what) {
    const RunResult result = run("correct " + json, head + row);
    EXPECT_EQ(result.code, 2) << row;
    EXPECT_EQ(result.out, "") << row;
    EXPECT_THAT(result.err, HasSubstr("stdin, row 3, column " + what)) << row;
  };
  says("1.1,left,20,me\n", "'bearing_rad': 'left' is not a number");
  says("1.1,0.5,warm,me\n", "'temperature_c': 'warm' is not a number");
  // Also where the row lacks something else: the column would be no covariate, and no row undone by it.
  says("1.1,,warm,me\n", "'temperature_c': 'warm' is not a number");
  says(",0.5,warm,me\n", "'temperature_c': 'warm' is not a number");
  const RunResult fine = run("correct " + json, head + "1.1,0.5,,me\n");  // nobody needs `by`
  EXPECT_EQ(fine.code, 0) << fine.err;
  EXPECT_EQ(count_of(fine.out, "1.1,,,,missing\n"), 1) << fine.out;
}

TEST_F(CorrectCommand, ADistanceThatThePriorDoesNotAllowIsFlagged) {
  const std::string json = save(line());
  folder.write("motion.csv", "reading_m,time_s\n0.6,0\n0.61,1\n1.6,2\n");  // 1, 1.02 and 3 m
  const RunResult motion =
      run("correct " + json + " " + folder.file("motion.csv") + " --prior motion --speed 0.1");
  ASSERT_EQ(motion.code, 0) << motion.err;
  EXPECT_EQ(count_of(motion.out, ",ok,"), 2) << motion.out;
  EXPECT_THAT(motion.out, HasSubstr("1.6,3.0"));
  EXPECT_EQ(count_of(motion.out, ",against_prior,"), 1) << motion.out;
  // f ends at 2.1 m, s = 1 cm: five standard deviations beyond, no distance explains the reading
  EXPECT_THAT(run("correct " + json + " --prior uniform", "2.15\n").out, HasSubstr("2.15,,,,out_of_range"));
  const RunResult half = run("correct " + json + " --prior map", "reading_m,prior_m,prior_sigma_m\n1.1,2,\n");
  EXPECT_EQ(half.code, 2);
  EXPECT_THAT(half.err, HasSubstr("prior_sigma_m"));
}

}  // namespace
}  // namespace rangecal::test
