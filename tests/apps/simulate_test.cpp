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
