// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;

TEST(PlanCommand, ProposesAnExperimentThatCanBeRehearsed) {
  const TemporaryFolder folder;
  const RunResult result = run("plan " + shipped("scenes/field-layout.yaml") + " --accuracy 12 --effects bearing_offset,tilt -o " + folder.file("plan.json") +
                               " --scene " + folder.file("plan.yaml"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("Plan "));
  EXPECT_THAT(result.out, HasSubstr("Line "));
  EXPECT_THAT(result.out, HasSubstr("tilt"));
  const auto json = nlohmann::json::parse(slurp(folder.file("plan.json")));
  EXPECT_EQ(json.at("format"), "rangecal-plan/1");
  EXPECT_LE(json.at("best").at("std_dev_m").get<double>(), 0.012);
  EXPECT_TRUE(json.at("line").is_null() || json.at("best").at("minutes") <= json.at("line").at("minutes"));
  EXPECT_EQ(json.at("best").at("effects").size(), 2u);
  ASSERT_EQ(run("simulate " + folder.file("plan.yaml") + " -o " + folder.file("rehearsal") + " --seed 3").code, 0);
  const RunResult rehearsal = run("calibrate " + folder.file("rehearsal") + " --order 2 --noise f2");
  EXPECT_EQ(rehearsal.code, 0) << rehearsal.err;
}

TEST(PlanCommand, SaysWhatItCannot) {
  const std::string scene = shipped("scenes/field-layout.yaml");
  const RunResult unreachable = run("plan " + scene + " --accuracy 0.01");
  EXPECT_EQ(unreachable.code, 1);
  EXPECT_THAT(unreachable.out, HasSubstr("the most accurate reaches"));
  EXPECT_EQ(run("plan " + scene + " --effects ghosts").code, 2);
  EXPECT_EQ(run("plan " + scene + " --accuracy -1").code, 2);
  EXPECT_EQ(run("plan " + scene + " --range 4 1").code, 2);
  EXPECT_EQ(run("plan " + shipped("scenes/pairs-2016.yaml")).code, 2);
  EXPECT_EQ(run("plan /nowhere.yaml").code, 2);
}

}  // namespace
}  // namespace rangecal::test
