// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <sstream>

#include "apps/run_binary.hpp"

namespace rangecal::test {
namespace {

using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

/// One line on stderr that holds every one of `parts`, nothing on stdout, exit code 2.
void expect_bad_input(const std::string& arguments, std::initializer_list<const char*> parts) {
  const RunResult result = run(arguments);
  EXPECT_EQ(result.code, 2) << arguments;
  EXPECT_THAT(result.out, IsEmpty()) << arguments;
  EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  EXPECT_EQ(result.err.rfind("rangecal: ", 0), 0u) << result.err;
  for (const char* part : parts) EXPECT_THAT(result.err, HasSubstr(part)) << arguments;
}

TEST(Usage, HelpTeachesWithExamples) {
  const RunResult top = run("--help");
  EXPECT_EQ(top.code, 0);
  for (const char* command : {"calibrate", "compare", "correct", "diagnose", "effects", "export", "extract",
                              "fleet", "import", "plan", "prove", "simulate", "study", "track"}) {
    EXPECT_THAT(top.out, HasSubstr(command));
    const RunResult help = run(std::string(command) + " --help");
    EXPECT_EQ(help.code, 0) << command;
    EXPECT_THAT(help.out, HasSubstr("Example")) << command;
    EXPECT_THAT(help.out, HasSubstr(std::string("rangecal ") + command)) << command;
  }
}

TEST(Usage, ManualPageSaysOfEachCommandWhatHelpSays) {
  const std::string page = slurp(std::string(RANGECAL_SOURCE_DIR) + "/docs/rangecal.1");
  const std::size_t begin = page.find(".SH COMMANDS"), end = page.find(".SH OPTIONS");
  ASSERT_LT(begin, end);
  const std::string commands = page.substr(begin, end - begin);
  const std::string help = run("--help").out;
  std::istringstream lines(help.substr(help.find("Subcommands:\n") + 13));
  int count = 0;
  std::string line;
  for (; std::getline(lines, line) && !line.empty(); ++count) {
    std::istringstream words(line);
    std::string name, text;
    words >> name >> std::ws;
    std::getline(words, text);
    EXPECT_THAT(commands, HasSubstr(".TP\n.B " + name + "\n" + text + "\n"));
  }
  EXPECT_GT(count, 10);
  EXPECT_EQ(count_of(commands, ".TP\n"), count);
}

TEST(Usage, VersionIsPrinted) {
  const RunResult result = run("--version");
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.out, ::testing::StartsWith("rangecal "));
}

TEST(Usage, WrongUsageIsOneLineAndCodeTwo) {
  expect_bad_input("", {"subcommand", "see 'rangecal --help'"});
  expect_bad_input("calibrat", {"calibrat", "see 'rangecal --help'"});
  expect_bad_input("calibrate", {"RECORDING", "see 'rangecal calibrate --help'"});
  expect_bad_input("import lego", {"DIR", "see 'rangecal import lego --help'"});
  expect_bad_input("calibrate --no-such-option x", {"no-such-option", "see 'rangecal calibrate --help'"});
  const std::string field = shipped("field-layout");
  expect_bad_input("calibrate " + field + " --method best", {"best", "marginal", "all"});
  expect_bad_input("calibrate " + field + " --order two", {"--order", "two"});
  expect_bad_input("calibrate " + field + " --order 9", {"--order", "9"});
  expect_bad_input("calibrate " + field + " --noise loud", {"loud"});
  expect_bad_input("compare " + field + " --solver g2o", {"g2o", "ceres"});
  expect_bad_input("compare " + field + " --noise-shape round", {"round"});
  expect_bad_input("compare " + field + " --weights heavy", {"heavy"});
  expect_bad_input("simulate " + shipped("scenes/field-layout.yaml"), {"--output"});
  expect_bad_input("plan " + shipped("scenes/field-layout.yaml") + " --accuracy -1",
                   {"--accuracy: Value -1 is not a positive number; see"});
  expect_bad_input("simulate " + shipped("scenes/field-layout.yaml") + " -o /tmp/never --seed -1",
                   {"--seed: Value -1 is not a whole number"});
  expect_bad_input("track x.csv --sigma-heading -1", {"--sigma-heading: Value -1 is not a number from 0 up"});
}

TEST(Usage, TooFewReadingsAreRefused) {
  const TemporaryFolder folder;
  folder.write("recording.yaml",
               "format: rangecal/1\nkind: pairs\nsensor: {name: s, range_min_m: 0.1, range_max_m: 10}\n");
  folder.write("pairs.csv", "true_m,reading_m\n1,1.01\n2,2.02\n");
  for (const char* command : {"calibrate ", "diagnose "})
    EXPECT_EQ(run(command + folder.path()).code, 2) << command;
  const TemporaryFolder landmarks;  // every reading in millimetres, beyond what the sensor reads
  std::filesystem::copy(
      shipped("field-layout"), landmarks.path(),
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  landmarks.write("observations.csv",
                  "stop,landmark,repeat,range_m,bearing_rad\n0,A,0,704,1\n0,B,0,1678,-0.3\n1,A,0,712,1.4\n");
  for (const char* command : {"calibrate ", "diagnose "}) {
    const RunResult result = run(command + landmarks.path());
    EXPECT_EQ(result.code, 2) << command << result.err;
    EXPECT_THAT(result.err, HasSubstr("3 of 3 readings lie above range_max_m")) << command;
  }
}

TEST(Usage, DistancesInMillimetresAreAskedAbout) {
  const TemporaryFolder folder;
  folder.write("recording.yaml",
               "format: rangecal/1\nkind: pairs\nsensor: {name: s, range_min_m: 0.1, range_max_m: 10}\n");
  std::string table = "true_m,reading_m\n";
  for (int i = 0; i < 30; ++i)
    table += std::to_string(500 + 100 * i) + "," + std::to_string(0.51 + 0.1 * i + 0.003 * (i % 3)) + "\n";
  folder.write("pairs.csv", table);
  for (const char* command : {"calibrate ", "diagnose "}) {
    const RunResult result = run(command + folder.path());
    EXPECT_EQ(result.code, 0) << result.err;
    EXPECT_THAT(result.out, HasSubstr("true_m")) << command;
    EXPECT_THAT(result.out, HasSubstr("another unit")) << command;
  }
}

TEST(Usage, WhatReadersNotedIsSaidByEveryCommandAndFile) {
  const TemporaryFolder folder;
  folder.write("recording.yaml", "format: rangecal/1\nkind: pairs\n");
  std::string table = "true_m,reading_m,level\n";
  for (int i = 0; i < 30; ++i)
    table += std::to_string(1.0 + 0.1 * i) + "," + std::to_string(1.01 + 0.1 * i + 0.003 * (i % 3)) + "," +
             (i == 7 ? std::string("high") : std::to_string(i)) + "\n";
  folder.write("pairs.csv", table);
  const std::string column = "row 9, column 'level': 'high' is not a number; the column is left out",
                    lone = "30 of 30 readings have a true_m that no other has";
  const std::string json = folder.file("out.json");
  for (const std::string command : {"calibrate", "compare", "diagnose"}) {
    const RunResult result =
        run(command + " " + folder.path() + (command == "compare" ? "" : " --json " + json));
    EXPECT_EQ(result.code, 0) << command << result.err;
    std::string words;  // lines are broken between words
    std::istringstream text(result.out);
    for (std::string word; text >> word;) words += (words.empty() ? "" : " ") + word;
    EXPECT_EQ(count_of(words, column), 1) << command << result.out;
    EXPECT_EQ(count_of(words, lone), 1) << command << result.out;
    if (command == "compare") continue;
    EXPECT_EQ(count_of(slurp(json), column), 1) << command;
    EXPECT_EQ(count_of(slurp(json), lone), 1) << command;
  }
}

TEST(Usage, InputThatIsMissingOrMixed) {
  expect_bad_input("calibrate /no/such/folder", {"/no/such/folder"});
  expect_bad_input("compare " + shipped("field-layout") + " " + shipped("pairs-2016"), {"mixed"});
  expect_bad_input("simulate /no/such/scene.yaml -o /tmp/never", {"/no/such/scene.yaml"});
  expect_bad_input("correct /no/such/calibration.json", {"/no/such/calibration.json"});
  expect_bad_input("calibrate " + shipped("field-layout") + " --from /no/such.json", {"/no/such.json"});
}

TEST(Usage, MalformedTableNamesFileRowAndColumn) {
  const TemporaryFolder folder;
  std::filesystem::copy(
      shipped("field-layout"), folder.path(),
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  folder.write("observations.csv", "stop,landmark,range_m,bearing_rad\n0,A,1.0,0.1\n0,B,far,0.1\n");
  expect_bad_input("calibrate " + folder.path(), {"observations.csv", "row 3", "range_m"});
}

TEST(Usage, FullRefusesToEstimateSigmaAndNamesMarginal) {
  const TemporaryFolder folder;
  std::filesystem::copy(
      shipped("field-layout"), folder.path(),
      std::filesystem::copy_options::recursive | std::filesystem::copy_options::overwrite_existing);
  folder.write("recording.yaml",
               "format: rangecal/1\nkind: landmarks\nsensor: {name: s, range_min_m: 0.1, range_max_m: 10}\n"
               "stops: {sigma_xy_m: estimate}\n");
  expect_bad_input("calibrate " + folder.path() + " --method full", {"sigma_xy_m", "marginal"});
  const RunResult marginal = run("calibrate " + folder.path() + " --order 2 --noise f2");
  EXPECT_EQ(marginal.code, 0) << marginal.err;
  EXPECT_THAT(marginal.out, HasSubstr("sigma_s"));
  const RunResult compare = run("compare " + folder.path() + " --order 2 --noise f2");
  EXPECT_EQ(compare.code, 0) << compare.err;
  EXPECT_THAT(compare.out, HasSubstr("unbounded"));
}

/// The command's results go to a disk that is full.
void expect_full_stdout(const std::string& command) {
  const TemporaryFolder folder;
  const int status = std::system(
      (std::string(RANGECAL_BINARY) + " " + command + " > /dev/full 2> " + folder.file("err")).c_str());
  EXPECT_EQ(WEXITSTATUS(status), 1);
  EXPECT_EQ(slurp(folder.file("err")), "rangecal: stdout: cannot be written: No space left on device\n");
}

TEST(Usage, StdoutThatCannotBeWrittenIsAnError) { expect_full_stdout("compare " + shipped("pairs-2016")); }

TEST(Usage, StdoutThatFillsUpIsAnError) {  // while a table is being printed, not at its end
  const TemporaryFolder folder;
  ASSERT_EQ(run("calibrate " + shipped("pairs-2016") + " --json " + folder.file("cal.json")).code, 0);
  std::string readings;
  for (int i = 0; i < 2000; ++i) readings += "1.5\n";
  folder.write("readings.txt", readings);
  expect_full_stdout("correct " + folder.file("cal.json") + " " + folder.file("readings.txt"));
}

TEST(Usage, LogFilesGoWhereAskedOnly) {
  const TemporaryFolder folder;
  EXPECT_EQ(run("compare " + shipped("pairs-2016") + " --log-dir " + folder.file("logs")).code, 0);
  EXPECT_FALSE(std::filesystem::is_empty(folder.file("logs")));
  const RunResult quiet = run("compare " + shipped("field-layout"));
  EXPECT_THAT(quiet.err, IsEmpty());
}

}  // namespace
}  // namespace rangecal::test
