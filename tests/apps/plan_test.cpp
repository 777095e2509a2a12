// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;

TEST(PlanCommand, ProposesAnExperimentThatCanBeRehearsed) {
  const TemporaryFolder folder;
  const RunResult result =
      run("plan " + shipped("scenes/field-layout.yaml") + " --accuracy 12 --effects bearing_offset,tilt -o " +
          folder.file("plan.json") + " --scene " + folder.file("plan.yaml"));
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_THAT(result.out, HasSubstr("Plan "));
  EXPECT_THAT(result.out, HasSubstr("Line "));
  EXPECT_THAT(result.out, HasSubstr("tilt"));
  const auto json = nlohmann::json::parse(slurp(folder.file("plan.json")));
  EXPECT_EQ(json.at("format"), "rangecal-plan/1");
  EXPECT_LE(json.at("best").at("std_dev_m").get<double>(), 0.012);
  EXPECT_TRUE(json.at("line").is_null() || json.at("best").at("minutes") <= json.at("line").at("minutes"));
  EXPECT_EQ(json.at("best").at("effects").size(), 2u);
  ASSERT_EQ(
      run("simulate " + folder.file("plan.yaml") + " -o " + folder.file("rehearsal") + " --seed 3").code, 0);
  const RunResult rehearsal = run("calibrate " + folder.file("rehearsal") + " --order 2 --noise f2");
  EXPECT_EQ(rehearsal.code, 0) << rehearsal.err;
}

TEST(PlanCommand, PlanAndLineStandUpInAStudy) {
  // Both are to have 12 mm at most between 0.5 and 4 m by their bound; over 200 simulated calibrations each the RMS error of
  // f, over distances where f' is 0.9 to 1.35, must not exceed it by more than 1.35 and what 200 repeats leave open: 3 *
  // sqrt(1 / (2 * 200)) = 15 %. And the plan takes less time than the line, by its own count.
  const TemporaryFolder folder;
  ASSERT_EQ(
      run("plan " + shipped("scenes/field-layout.yaml") + " --accuracy 12 -o " + folder.file("plan.json") +
          " --scene " + folder.file("plan.yaml") + " --line-scene " + folder.file("line.yaml"))
          .code,
      0);
  folder.write(
      "study.yaml",
      "format: rangecal-study/1\nname: plan-or-line\nscene: plan.yaml\ngrid:\n  - {parameter: scene, values: [plan.yaml, line.yaml]}\n"
      "repeats: 200\nfit: {order: 2}\nestimators: [marginal]\nmeasures: [rmse, coverage, failures]\n"
      "curve_m: [0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4]\n");
  const RunResult study = run("study " + folder.file("study.yaml") + " -o " + folder.file("out"));
  ASSERT_EQ(study.code, 0) << study.err;
  std::istringstream table(slurp(folder.file("out") + "/results.csv"));
  std::string line, field;
  std::vector<std::vector<std::string>> rows;
  while (std::getline(table, line)) {
    rows.emplace_back();
    std::istringstream fields(line);
    while (std::getline(fields, field, ',')) rows.back().push_back(field);
  }
  ASSERT_EQ(rows.size(), 3u);
  const auto column = [&](const std::string& name) {
    return static_cast<std::size_t>(std::find(rows[0].begin(), rows[0].end(), name) - rows[0].begin());
  };
  for (std::size_t i : {1u, 2u}) {
    EXPECT_LT(std::stod(rows[i].at(column("curve_rmse_m"))), 0.012 * 1.35 * 1.15) << rows[i][1];
    EXPECT_GT(std::stod(rows[i].at(column("curve_coverage95"))), 0.9) << rows[i][1];
  }
  const auto json = nlohmann::json::parse(slurp(folder.file("plan.json")));
  EXPECT_LT(json.at("best").at("minutes").get<double>(), json.at("line").at("minutes").get<double>());
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
