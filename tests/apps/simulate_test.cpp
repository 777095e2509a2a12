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

}  // namespace
}  // namespace rangecal::test
