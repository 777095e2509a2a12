// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <regex>
#include <sstream>
#include <string>
#include <tuple>
#include <vector>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr const char* environment = "GLOG_v=9 GLOG_logtostderr=1 GLOG_minloglevel=0";
constexpr const char* with_causes = "concealed/world-01";

/// What glog puts in front is left out.
std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream stream(text);
  for (std::string line; std::getline(stream, line);) {
    const std::size_t end = line.find("] ");
    lines.push_back(end == std::string::npos ? line : line.substr(end + 2));
  }
  return lines;
}

TEST(Verbose, NothingIsSaidUnlessAskedFor) {
  for (const std::string& command :
       {"compare " + shipped("field-layout"), "compare " + shipped("field-layout") + " --solver ceres",
        "calibrate " + shipped("pairs-2016"), "diagnose " + shipped(with_causes),
        "compare --verbose=0 " + shipped("pairs-2016")}) {
    const RunResult result = run(command, "", environment);
    EXPECT_EQ(result.code, 0) << command;
    EXPECT_THAT(result.err, IsEmpty()) << command;
  }
}

TEST(Verbose, EveryMethodOfCompareSaysItsIterationsAndItsEnd) {
  const std::string numbers = "cost -?[0-9]+\\.[0-9]{6}, step [-+.e0-9]+, gradient [-+.e0-9]+";
  for (const auto& [solver, full, damping] :
       {std::tuple("block", "full block", "lambda"), std::tuple("ceres", "full ceres", "radius")}) {
    const RunResult result =
        run("compare " + shipped("field-layout") + " --order 2 --noise f2 -vv --solver " + solver);
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_THAT(result.out,
                Not(HasSubstr("CHOLMOD")));  // Ceres prints its memory to stdout where it is asked
    for (const std::string& line :
         {fmt::format("{} [0-9]+: {}, {} [-+.e0-9]+\n", full, numbers, damping),
          fmt::format("marginal [0-9]+: {}, length [-+.e0-9]+\n", numbers),
          std::string("approximate [0-9]+: cost -, step [-+.e0-9]+, gradient -\n"),
          fmt::format("{} \\(order 2, noise f2\\): converged after [0-9]+ iterations, cost ", full),
          std::string("marginal \\(order 2, noise f2\\): converged after [0-9]+ iterations, cost "),
          std::string("approximate \\(order 2, noise f2\\): converged after [0-9]+ iterations\n"),
          std::string("closed-form \\(order 2, noise f2\\): converged\n")})
      EXPECT_THAT(result.err, ContainsRegex(line)) << line;
  }
  const RunResult ends = run("compare " + shipped("field-layout") + " --order 2 --noise f2 --verbose");
  EXPECT_THAT(ends.err, HasSubstr("marginal (order 2, noise f2): converged after"));
  EXPECT_THAT(ends.err, Not(ContainsRegex("marginal [0-9]+: ")));
  const RunResult pairs = run("compare " + shipped("pairs-2016") + " -vv");
  ASSERT_EQ(pairs.code, 0) << pairs.err;
  for (const std::string& line :
       {"pairs newton [0-9]+: " + numbers, "pairs reml [0-9]+: " + numbers,
        std::string("pairs full \\(order 2, noise [a-z0-9]+, gaussian\\): converged after"),
        std::string("pairs marginal \\(order "), std::string("closed-form \\(order "),
        std::string("approximate \\(order ")})
    EXPECT_THAT(pairs.err, ContainsRegex(line)) << line;
}

TEST(Verbose, ASearchSaysOfEverySetWhatTheTraceSays) {
  const TemporaryFolder folder;
  const RunResult result =
      run("diagnose " + shipped(with_causes) + " -v --trace " + folder.file("trace.json"));
  ASSERT_EQ(result.code, 0) << result.err;
  const nlohmann::json trace = nlohmann::json::parse(slurp(folder.file("trace.json")));
  ASSERT_GT(trace.at("sets").size(), 5u);
  for (const nlohmann::json& set : trace.at("sets")) {
    if (set.at("members").empty()) continue;  // what the others are compared with
    std::string members;
    for (const std::string member : set.at("members")) members += (members.empty() ? "" : " + ") + member;
    const std::string weighed = fmt::format("-> {:.2f} (gain {:.2f}", set.at("log_posterior").get<double>(),
                                            set.at("gain").get<double>());
    bool found = false;
    for (const std::string& line : lines_of(result.err))
      found =
          found || (line.starts_with("hypothesis " + members + " (") &&
                    line.find(weighed) != std::string::npos && line.find("): kept, ") != std::string::npos);
    EXPECT_TRUE(found) << members << " " << weighed << "\n" << result.err;
  }
  const RunResult clean = run("diagnose " + shipped("field-layout") + " -v");
  EXPECT_THAT(clean.err, HasSubstr("raises no alarm"));
  EXPECT_THAT(clean.err, Not(HasSubstr("hypothesis")));
}

/// A file less the time that the solve took.
std::string timeless(const std::string& path) {
  static const std::regex seconds(R"("seconds": [-+.e0-9]+)");
  return std::regex_replace(slurp(path), seconds, "");
}

TEST(Verbose, ResultsHaveTheSameBits) {
  const TemporaryFolder folder;
  for (const std::string& command :
       {"calibrate " + shipped("field-layout"), "calibrate " + shipped("pairs-2016"),
        "diagnose " + shipped(with_causes)}) {
    const RunResult quiet = run(command + " --json " + folder.file("quiet.json")),
                    told = run(command + " -vv --json " + folder.file("told.json"));
    EXPECT_EQ(quiet.code, told.code);
    EXPECT_THAT(told.err, Not(IsEmpty())) << command;
    EXPECT_EQ(timeless(folder.file("quiet.json")), timeless(folder.file("told.json"))) << command;
  }
}

TEST(Verbose, LinesAlsoGoIntoLogFiles) {
  const TemporaryFolder folder;
  const RunResult result = run("calibrate " + shipped("pairs-2016") + " -v --log-dir " + folder.file("logs"));
  EXPECT_THAT(result.err, HasSubstr("pairs marginal (order"));
  std::string logged;
  for (const auto& entry : std::filesystem::directory_iterator(folder.file("logs")))
    logged += slurp(entry.path());
  EXPECT_THAT(logged, HasSubstr("pairs marginal (order"));
}

TEST(Verbose, WhatIsNoLevelIsRefused) {
  for (const char* level : {"x", "-1", "2.5", "100"}) {
    const RunResult result = run("compare " + shipped("pairs-2016") + " --verbose=" + level);
    EXPECT_EQ(result.code, 2) << level;
    EXPECT_THAT(result.err, HasSubstr(fmt::format("'{}' is not a level", level)));
  }
}

/// Numbers are left out: machines round differently.
std::string masked(const std::string& text) {
  static const std::regex number(R"(-?[0-9]+(\.[0-9]+)?(e[-+][0-9]+)?)");
  return std::regex_replace(text, number, "#");
}

TEST(Verbose, TheDocumentShowsWhatIsPrinted) {
  std::istringstream text(slurp(std::string(RANGECAL_SOURCE_DIR) + "/docs/diagnosis.md"));
  std::string line, said;
  while (std::getline(text, line) && line != "### How to follow a solve") {
  }
  int shown = 0;
  bool in_block = false;
  while (std::getline(text, line) && !line.starts_with("#")) {
    if (line.starts_with("```")) {
      in_block = line == "```console";
      continue;
    }
    if (!in_block || line.empty()) continue;
    if (line.starts_with("$ rangecal ")) {
      const RunResult result = run(line.substr(11), "", "cd " RANGECAL_SOURCE_DIR " &&");
      EXPECT_EQ(result.code, 0) << line;
      said.clear();
      for (const std::string& one : lines_of(result.err)) said += masked(one) + "\n";
    } else if (line != "...") {
      ++shown;
      EXPECT_THAT(said, HasSubstr(masked(line) + "\n")) << line;
    }
  }
  EXPECT_GT(shown, 8);
}

}  // namespace
}  // namespace rangecal::test
