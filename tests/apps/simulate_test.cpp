// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;

TEST(SimulateCommand, SameSeedSameFiles) {
  const TemporaryFolder folder;
  const std::string scene = "simulate " + shipped("scenes/2021-setting.yaml") + " -o ";
  const RunResult first = run(scene + folder.file("a") + " --seed 7");
  ASSERT_EQ(first.code, 0) << first.err;
  EXPECT_THAT(first.out, HasSubstr("20 stops, 5 landmarks, 100 readings"));
  ASSERT_EQ(run(scene + folder.file("b") + " --seed 7").code, 0);
  ASSERT_EQ(run(scene + folder.file("c") + " --seed 8").code, 0);
  for (const char* file :
       {"observations.csv", "stops.csv", "truth_stops.csv", "truth_landmarks.csv", "recording.yaml"}) {
    const std::string text = slurp(folder.file("a/") + file);
    EXPECT_FALSE(text.empty()) << file;
    EXPECT_EQ(text, slurp(folder.file("b/") + file)) << file;
  }
  EXPECT_NE(slurp(folder.file("a/observations.csv")), slurp(folder.file("c/observations.csv")));
  EXPECT_EQ(run("compare " + folder.file("a") + " --order 2 --noise f").code, 0);
}

TEST(SimulateCommand, NothingIsWrittenForABadScene) {
  const TemporaryFolder folder;
  folder.write("scene.yaml", "format: rangecal-scene/1\nkind: landmarks\nsensors: {}\n");
  const RunResult result = run("simulate " + folder.file("scene.yaml") + " -o " + folder.file("out"));
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("sensors"));
  EXPECT_FALSE(std::filesystem::exists(folder.file("out")));
}

TEST(SimulateCommand, EffectsAndOpticsStandInTheRecordingAsTruthThatNobodyReads) {
  const TemporaryFolder folder;
  const RunResult planted =
      run("simulate " + shipped("scenes/field-layout-effects.yaml") + " -o " + folder.file("a"));
  ASSERT_EQ(planted.code, 0) << planted.err;
  EXPECT_THAT(planted.out, HasSubstr("1000 readings"));
  const std::string head =
      "# made by rangecal simulate\n# with this in it, as its scene says it:\n#   effects:\n"
      "#     quantisation: {disparity_step_per_m: 0, output_step_m: 0.01}\n"
      "#     range_eccentricity: {cosine_m: 0.02, sine_m: 0}\nformat: rangecal/1\n";
  EXPECT_EQ(slurp(folder.file("a/recording.yaml")).substr(0, head.size()), head);
  const RunResult found = run("diagnose " + folder.file("a"));
  EXPECT_THAT(found.out, HasSubstr("range_eccentricity"));
  EXPECT_THAT(found.out, HasSubstr("quantisation"));
  // What a program made may be made again.
  const RunResult optical =
      run("simulate " + shipped("scenes/field-layout-optical.yaml") + " -o " + folder.file("a"));
  ASSERT_EQ(optical.code, 0) << optical.err;
  EXPECT_THAT(
      slurp(folder.file("a/recording.yaml")),
      HasSubstr("#   sensor: {model: optical, focal_mm: 14, nominal_focal_mm: 14.4, laser_angle_rad: 0.0002, "
                "range_zero_m: 0.02}\n"));
  EXPECT_EQ(run("calibrate " + folder.file("a") + " --order 2").code, 0);
}

TEST(SimulateCommand, AFaultOfAnEffectIsOneLineAndOthersRefuseScenesWithEffects) {
  const TemporaryFolder folder;
  std::string scene = slurp(shipped("scenes/field-layout.yaml"));
  scene += "effects: {range_eccentricity: {cosine_m: 50}}\n";
  folder.write("scene.yaml", scene);
  const RunResult result = run("simulate " + folder.file("scene.yaml") + " -o " + folder.file("out"));
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("field 'effects.range_eccentricity.cosine_m': 50 is outside -10 to 10"));
  EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  EXPECT_FALSE(std::filesystem::exists(folder.file("out")));
  for (const char* other : {"field-layout-effects", "field-layout-optical"}) {
    const RunResult plan = run("plan " + shipped(std::string("scenes/") + other + ".yaml"));
    EXPECT_EQ(plan.code, 2);
    EXPECT_THAT(plan.err, HasSubstr("the seed model alone is taken here"));
  }
}

TEST(SimulateCommand, ARecordingWithoutAReadingIsRefusedWithItsReason) {
  // One landmark 9.2 m beside a path of 0.9 m: 9.2 m away at the nearest, 9.21 m from its start.
  const std::string
      begin =
          "format: rangecal-scene/1\nstops: {line: {count: 4, step_m: 0.3}, sigma_xy_m: 0}\nrepeats: 2\n"
          "landmarks: {list: [{landmark: A, x_m: 0.45, y_m: 9.2}]}\n",
      sensor = "alpha: [0.0, 1.0], noise: {law: f2, sigma: 0.00001}, sigma_theta_rad: 0.005}\n";
  const auto says = [&](const std::string& scene, const std::string& why) {
    const TemporaryFolder folder;
    folder.write("scene.yaml", scene);
    const RunResult result = run("simulate " + folder.file("scene.yaml") + " -o " + folder.file("out"));
    EXPECT_EQ(result.code, 2);
    EXPECT_THAT(result.err, HasSubstr("scene.yaml: the recording would hold no reading: " + why));
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_EQ(result.out, "");
    EXPECT_FALSE(std::filesystem::exists(folder.file("out")));
  };
  says(
      begin + "sensor: {" + sensor + "visibility: {min_m: 0.1, max_m: 4}\n",
      "no landmark is seen from any stop: their surfaces are 9.2 to 9.21 m away, and visibility is 0.1 to 4 m");
  says(begin + "sensor: {range_min_m: 0.2, range_max_m: 6, " + sensor,
       "none of 8 readings can be used: 8 above range_max_m; the sensor reads 0.2 to 6 m");
  says(
      "format: rangecal-scene/1\nkind: pairs\nbatches: {distances_m: [7], readings: 5}\n"
      "sensor: {range_min_m: 0.2, range_max_m: 6, alpha: [0.0, 1.0], noise: {law: f2, sigma: 0.00001}}\n",
      "none of 5 readings can be used: 5 above range_max_m; the sensor reads 0.2 to 6 m");
}

TEST(SimulateCommand, MeasurementsAreNotReplaced) {
  const TemporaryFolder folder;
  const std::string scene = "simulate " + shipped("scenes/pairs-2016.yaml") + " -o ";
  std::filesystem::create_directories(folder.file("real"));
  folder.write("real/observations.csv", "stop,landmark,range_m,bearing_rad\n0,A,1,0\n");
  const RunResult result = run(scene + folder.file("real"));
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("would be lost"));
  EXPECT_EQ(slurp(folder.file("real/observations.csv")), "stop,landmark,range_m,bearing_rad\n0,A,1,0\n");
  ASSERT_EQ(run(scene + folder.file("sim")).code, 0);  // what was simulated may be simulated again
  EXPECT_EQ(run(scene + folder.file("sim") + " --seed 2").code, 0);
  // nor by another command's result, and no two results go into one file
  const std::string pairs = slurp(folder.file("sim/pairs.csv"));
  const RunResult over = run("calibrate " + folder.file("sim") + " --json " + folder.file("sim/pairs.csv"));
  EXPECT_EQ(over.code, 2);
  EXPECT_THAT(over.err, HasSubstr("is a table of a recording"));
  EXPECT_EQ(run("track " + folder.file("sim/pairs.csv") + " -o " + folder.file("sim/pairs.csv")).code, 2);
  EXPECT_EQ(slurp(folder.file("sim/pairs.csv")), pairs);
  EXPECT_THAT(run("diagnose " + folder.file("sim") + " --json " + folder.file("a.json") + " --calibration " +
                  folder.file("a.json"))
                  .err,
              HasSubstr("is named as the file of two results"));
}

}  // namespace
}  // namespace rangecal::test
