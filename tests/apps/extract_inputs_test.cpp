// SPDX-License-Identifier: BSD-3-Clause
// Files of scans as they come: cut off while they were written, through a pipe, named twice.
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/recording_io.hpp"
#include "support/half_circle_scan.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

/// Ranges of four scans, 0.1 m apart along x.
std::vector<std::string> ranges_of(int k) {
  std::vector<std::string> ranges;
  for (const double range : half_circle_from(0.1 * k)) ranges.push_back(fmt::format("{:.4f}", range));
  return ranges;
}

/// The scans as a CARMEN log; as CSV, one scan a line, or one beam a line.
std::string carmen_log() {
  std::string text;
  for (int k = 0; k < 4; ++k)
    text += fmt::format("FLASER 180 {0} {1} 0 0 {1} 0 0 {2} host {3}\n", fmt::join(ranges_of(k), " "),
                        0.1 * k, 10 + k, k);
  return text;
}
std::string scan_lines() {
  std::string text = "stamp,angle_min,angle_increment,ranges...\n";
  for (int k = 0; k < 4; ++k)
    text += fmt::format("{},{},{},{}\n", 10 + k, -0.5 * std::numbers::pi, std::numbers::pi / 180.0,
                        fmt::join(ranges_of(k), ","));
  return text;
}
std::string beam_lines() {
  std::string text = "stamp,angle_rad,range_m\n";
  for (int k = 0; k < 4; ++k)
    for (int i = 0; const std::string& range : ranges_of(k))
      text += fmt::format("{},{:.6f},{}\n", 10 + k, (i++ - 90) * std::numbers::pi / 180.0, range);
  return text;
}

const std::string kOptions = " --split scan --radius 0.12 -o ";

TEST(ExtractInputs, ALogThatWasCutOffGivesItsWholeScans) {
  const TemporaryFolder folder;
  const std::string log = carmen_log();
  folder.write("robot.log", log.substr(0, log.size() - 200));
  const RunResult result = run("extract " + folder.file("robot.log") + kOptions + folder.file("rec"));
  EXPECT_EQ(result.code, 0);
  EXPECT_EQ(result.err,
            "rangecal: " + folder.file("robot.log") +
                ", row 4: the last line is torn, as where a recording was cut off, and is left out\n");
  EXPECT_EQ(load_recording(folder.file("rec")).stops.size(), 3u);

  const std::size_t second = log.find('\n') + 1;
  folder.write("robot.log", log.substr(0, second + 200) + "\n" + log.substr(second));
  const RunResult middle = run("extract " + folder.file("robot.log") + kOptions + folder.file("other"));
  EXPECT_EQ(middle.code, 2);
  EXPECT_THAT(middle.err, HasSubstr("robot.log, row 2"));
  EXPECT_FALSE(fs::exists(folder.file("other")));
}

TEST(ExtractInputs, CsvThatWasCutOffGivesItsWholeScans) {
  const TemporaryFolder folder;
  folder.write("stops.csv", "stop,x_m,y_m,heading_rad\n0,0,0,0\n1,0.1,0,0\n2,0.2,0,0\n");
  const std::string left_out = ": the last line is torn, as where a recording was cut off, and is left out";
  const std::string lines = scan_lines(), beams = beam_lines();
  const int last = count_of(beams.substr(0, beams.size() - 203), "\n") + 1;
  for (const auto& [text, warning] :
       {std::pair{lines.substr(0, lines.size() - 200), ", row 5" + left_out},
        {beams.substr(0, beams.size() - 203),
         fmt::format(", row {}{} with the scan that it is of", last, left_out)}}) {
    folder.write("scans.csv", text);
    const RunResult result = run("extract " + folder.file("scans.csv") + " --stops " +
                                 folder.file("stops.csv") + kOptions + folder.file("rec"));
    EXPECT_EQ(result.code, 0);
    EXPECT_EQ(result.err, "rangecal: " + folder.file("scans.csv") + warning + "\n");
    const Recording recording = load_recording(folder.file("rec"));
    EXPECT_EQ(recording.stops.size(), 3u);
    EXPECT_EQ(recording.landmarks.size(), 3u);
  }
}

TEST(ExtractInputs, StdinIsReadAsAFileIs) {
  const TemporaryFolder folder;
  folder.write("robot.log", carmen_log());
  ASSERT_EQ(run("extract " + folder.file("robot.log") + kOptions + folder.file("rec")).code, 0);
  const RunResult redirected = run("extract -" + kOptions + folder.file("redirected"), carmen_log());
  EXPECT_EQ(redirected.code, 0) << redirected.err;
  const std::string piped = "cat " + folder.file("robot.log") + " | " + RANGECAL_BINARY + " extract -" +
                            kOptions + folder.file("piped") + " > " + folder.file("out");
  EXPECT_EQ(std::system(piped.c_str()), 0);
  for (const char* name : {"redirected", "piped"}) {
    EXPECT_EQ(slurp(folder.file(name) + "/observations.csv"), slurp(folder.file("rec/observations.csv")))
        << name;
    EXPECT_THAT(slurp(folder.file(name) + "/recording.yaml"), HasSubstr("source: stdin")) << name;
  }
  const RunResult short_line = run("extract -" + kOptions + folder.file("x"), "FLASER 4 1 2\n");
  EXPECT_EQ(short_line.code, 2);
  EXPECT_THAT(short_line.err, HasSubstr("stdin, row 1"));
}

TEST(ExtractInputs, AFileThatIsNamedTwiceIsRefused) {
  const TemporaryFolder folder;
  folder.write("robot.log", carmen_log());
  fs::create_symlink("robot.log", folder.file("link.log"));
  fs::create_hard_link(folder.file("robot.log"), folder.file("hard.log"));
  for (const char* other : {"robot.log", "link.log", "hard.log", "./robot.log"}) {
    const RunResult result =
        run(std::string("extract robot.log ") + other + kOptions + "rec", "", "cd " + folder.path() + ";");
    EXPECT_EQ(result.code, 2) << other;
    EXPECT_THAT(result.err, HasSubstr("its readings would count twice")) << other;
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(fs::exists(folder.file("rec")));
  }
  const RunResult stdin_twice = run("extract - -" + kOptions + folder.file("rec"), carmen_log());
  EXPECT_EQ(stdin_twice.code, 2);
  EXPECT_THAT(stdin_twice.err, HasSubstr("rangecal: stdin: is named twice"));
  fs::copy_file(folder.file("robot.log"), folder.file("copy.log"));  // a file of its own
  EXPECT_EQ(run("extract " + folder.file("robot.log") + " " + folder.file("copy.log") + kOptions +
                folder.file("rec"))
                .code,
            0);
}

TEST(ExtractInputs, NoResultTakesTheirPlace) {
  const TemporaryFolder folder;
  folder.write("robot.log", carmen_log());
  ASSERT_EQ(run("extract " + folder.file("robot.log") + kOptions + folder.file("rec")).code, 0);
  for (const auto& [arguments, file] : {std::pair{" --json robot.log" + kOptions + "new", "robot.log"},
                                        {" --stops rec/stops.csv" + kOptions + "rec", "rec/stops.csv"}}) {
    const std::string before = slurp(folder.file(file));
    const RunResult result = run("extract robot.log" + arguments, "", "cd " + folder.path() + ";");
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_THAT(result.err, HasSubstr("would be lost")) << arguments;
    EXPECT_EQ(slurp(folder.file(file)), before);
  }
  EXPECT_FALSE(fs::exists(folder.file("new")));
}

}  // namespace
}  // namespace rangecal::test
