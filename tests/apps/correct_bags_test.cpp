// SPDX-License-Identifier: BSD-3-Clause
// rangecal correct on bags of ROS 2.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "support/bag_writers.hpp"
#include "support/calibration_of.hpp"
#include "support/outside_programs.hpp"
#include "support/recordings.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

const std::vector<WrittenTopic> kTwoTopics = {{"/scan", "sensor_msgs/msg/LaserScan"},
                                              {"/odom", "nav_msgs/msg/Odometry"}};

/// Thirty scans of 1, 2, 3, 4.2 and 9 m and no return, odometry between them.
std::vector<WrittenMessage> thirty_scans() {
  std::vector<WrittenMessage> out;
  const float none = std::numeric_limits<float>::infinity();
  for (int i = 0; i < 30; ++i) {
    const auto now = static_cast<std::int64_t>(1e8 * i);
    out.push_back({0, now, laser_scan(0.1 * i, -1.0f, 0.4f, {1.0f, 2.0f, 3.0f, 4.2f, 9.0f, none})});
    out.push_back({1, now, odometry(0.1 * i, 0.0, 0.0, 0.0)});
  }
  return out;
}

class CorrectBags : public ::testing::Test {
 protected:
  void SetUp() override {
    // d = y - 0.1, from 0.3 to 4 m, and up to 4.37 m extrapolated
    Calibration line =
        rangecal::testing::calibration_of(Eigen::Vector2d(0.1, 1.0), NoiseLaw::constant, 0.001, 0.3, 4.0);
    save_calibrations({line}, file("cal.json"));
    folder.write("run.mcap", mcap_file(kTwoTopics, thirty_scans(), {7, "lz4"}));
  }
  std::string file(const std::string& name) const { return folder.file(name); }
  RunResult correct(const std::string& arguments) const {
    return run("correct " + file("cal.json") + " " + arguments);
  }
  TemporaryFolder folder;
};

TEST_F(CorrectBags, SaysWhatBecameOfTheReadings) {
  const RunResult result = correct(file("run.mcap") + " -o " + file("out.mcap") + " --keep-raw /scan_raw");
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(
      result.out,
      "/scan: 30 messages of sensor_msgs/LaserScan, 180 readings: 120 corrected, 30 no returns kept, 30 without a "
      "distance (NaN), 0 ambiguous (the most likely distance)\nwritten to " +
          file("out.mcap") + " (MCAP)\n");
  EXPECT_EQ(
      result.err,
      "rangecal: 30 of 150 readings are flagged extrapolated: at distances outside the 0.3 to 4 m of the fit\n"
      "rangecal: 30 of 150 readings are flagged out_of_range: read at no distance of the fit, nor near its ends\n");
  const RunResult topics = run("extract " + file("out.mcap") + " --topics");
  EXPECT_EQ(topics.out,
            "/odom: nav_msgs/Odometry, 30 messages\n/scan: sensor_msgs/LaserScan, 30 messages\n"
            "/scan_raw: sensor_msgs/LaserScan, 30 messages\n");
  EXPECT_EQ(topics.err, "");
}

TEST_F(CorrectBags, TheSameBagTwiceIsTheSameFile) {
  ASSERT_EQ(correct(file("run.mcap") + " -o " + file("a.mcap")).code, 0);
  ASSERT_EQ(correct(file("run.mcap") + " -o " + file("b.mcap")).code, 0);
  EXPECT_EQ(slurp(file("a.mcap")), slurp(file("b.mcap")));
}

TEST_F(CorrectBags, WrongInputIsOneLineAndLeavesNothingBehind) {
  folder.write("a.csv", "reading_m\n1\n");
  folder.write("half.db3", "SQLite format 3");
  fs::create_directory(file("folder"));
  const auto refused = [&](const std::string& arguments, const std::string& word) {
    const RunResult result = correct(arguments);
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_EQ(result.out, "");
    EXPECT_THAT(result.err, HasSubstr(word)) << arguments;
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(fs::exists(file("out.mcap")));
  };
  const std::string out = " -o " + file("out.mcap");
  refused(file("run.mcap"), "is a bag: -o names the corrected one");
  refused(file("run.mcap") + " -o " + file("run.mcap"), "is read, and would be lost");
  refused(file("run.mcap") + " -o " + file("cal.json"), "is read, and would be lost");
  refused(file("run.mcap") + " -o " + file("folder"), "it is a folder");
  refused(file("run.mcap") + " -o " + file("none/out.mcap"), "cannot be written");
  refused(file("run.mcap") + " -o /dev/null", "to a file only");
  refused(file("run.mcap") + out + " --topic /odom", "is of nav_msgs/Odometry");
  refused(file("run.mcap") + out + " --topic /none", "its topics: /odom (nav_msgs/Odometry), /scan");
  refused(file("run.mcap") + out + " --prior uniform", "about a table");
  refused(file("a.csv") + out, "is no bag");
  refused(file("a.csv") + " --topic /scan", "about a bag");
  refused(file("half.db3") + out, "is no bag: its first bytes");
  refused(file("folder") + out, "is a folder");
  refused(file("none.mcap") + out, "none.mcap: no such file");
  EXPECT_EQ(slurp(file("run.mcap")), mcap_file(kTwoTopics, thirty_scans(), {7, "lz4"}));
  EXPECT_EQ(
      std::distance(fs::directory_iterator(fs::path(file("x")).parent_path()), fs::directory_iterator()), 5);
}

TEST_F(CorrectBags, AFullDiskLeavesNothingBehind) {
  const RunResult result = run(
      "correct " + file("cal.json") + " " + file("run.mcap") + " -o " + file("out.mcap"), "", "ulimit -f 4;");
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err, HasSubstr("out.mcap: cannot be written"));
  EXPECT_FALSE(fs::exists(file("out.mcap")));
  EXPECT_EQ(
      std::distance(fs::directory_iterator(fs::path(file("x")).parent_path()), fs::directory_iterator()), 2);
}

/// What @mcap/core finds in a file.
nlohmann::json read_outside(const std::string& path) {
  const std::string found = run_outside("read.mjs", path);
  return found.empty() ? nlohmann::json() : nlohmann::json::parse(found);
}

TEST_F(CorrectBags, TheOutsideReaderAcceptsWhatIsWritten) {
  RANGECAL_REQUIRE_OUTSIDE();
  std::vector<std::string> inputs;
  for (const char* compression : {"", "lz4", "zstd"})
    for (const bool summary : {false, true}) {
      inputs.push_back(fmt::format("in-{}-{}.mcap", compression, summary));
      folder.write(inputs.back(),
                   mcap_file(kTwoTopics, thirty_scans(), {7, compression, true, false, summary, true}));
    }
  inputs.push_back("plain.mcap");
  folder.write("plain.mcap", mcap_file(kTwoTopics, thirty_scans(), {0}));
  for (const std::string& input : inputs) {
    SCOPED_TRACE(input);
    ASSERT_EQ(correct(file(input) + " -o " + file("out.mcap") + " --keep-raw /scan_raw").code, 0);
    const nlohmann::json after = read_outside(file("out.mcap"));
    EXPECT_EQ(after["topics"], after["streamed"]);  // by the index as from start to end
    EXPECT_EQ(after["messages"], 90);
    EXPECT_EQ(after["counts"], (nlohmann::json{{"/scan", 30}, {"/scan_raw", 30}, {"/odom", 30}}));
    EXPECT_EQ(after["groups"], (nlohmann::json{3, 4, 11, 8, 13}));
    EXPECT_EQ(after["metadata"].back()[0], "rangecal correct");
    EXPECT_EQ(after["metadata"].back()[1]["topic"], "/scan");
    EXPECT_GT(after["dataSectionCrc"], 0);
    if (input.find("-true") == std::string::npos) continue;
    const nlohmann::json before = read_outside(file(input));
    EXPECT_EQ(after["topics"]["/odom"], before["topics"]["/odom"]);
    EXPECT_EQ(after["topics"]["/scan_raw"], before["topics"]["/scan"]);
    EXPECT_EQ(after["schemas"], before["schemas"]);
    EXPECT_EQ(after["chunks"], before["chunks"]);
    EXPECT_EQ(after["profile"], before["profile"]);
  }
}

// By the outside writer, through ours, to the outside reader: all that is not corrected comes out as it went in.
TEST_F(CorrectBags, ABagByTheOutsideWriterComesBackToTheOutsideReader) {
  RANGECAL_REQUIRE_OUTSIDE();
  const std::string table = rangecal::testing::recordings() + "/rplidar-a2-room/scans.csv";
  RANGECAL_REQUIRE_RECORDING(table);
  for (const auto& [indexed, options] :
       {std::pair(true, R"("compression": "lz4", "chunks": true, "index": true, "bigEndian": true)"),
        std::pair(false, R"("compression": "zstd", "chunks": true, "index": false, "bigEndian": false)"),
        std::pair(false, R"("compression": "", "chunks": false, "index": true, "bigEndian": true)")}) {
    SCOPED_TRACE(options);
    run_outside("write.mjs", fmt::format("{} {} '{{\"scans\": 50, {}}}'", table, file("in.mcap"), options));
    ASSERT_EQ(correct(file("in.mcap") + " -o " + file("out.mcap") + " --keep-raw /scan_raw").code, 0);
    const nlohmann::json after = read_outside(file("out.mcap"));
    EXPECT_EQ(after["topics"], after["streamed"]);
    EXPECT_EQ(after["counts"],
              (nlohmann::json{{"/scan", 50}, {"/scan_raw", 50}, {"/odom", 50}, {"/tf", 50}}));
    EXPECT_EQ(after["profile"], "ros2");
    EXPECT_GT(after["dataSectionCrc"], 0);
    if (!indexed) continue;  // the outside reader asks for an index of chunks
    const nlohmann::json before = read_outside(file("in.mcap"));
    for (const auto& [from, to] : {std::pair("/odom", "/odom"), {"/tf", "/tf"}, {"/scan", "/scan_raw"}})
      EXPECT_EQ(after["topics"][to], before["topics"][from]) << to;
    EXPECT_NE(after["topics"]["/scan"]["digest"], before["topics"]["/scan"]["digest"]);
  }
}

}  // namespace
}  // namespace rangecal::test
