// SPDX-License-Identifier: BSD-3-Clause
// rangecal extract on bags of ROS 2: a robot that stands at four places among three cylinders.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "apps/run_binary.hpp"
#include "rangecal/core/recording_io.hpp"
#include "support/bag_writers.hpp"
#include "support/half_circle_scan.hpp"

namespace rangecal::test {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;

std::vector<float> beams_from(double x) {
  const std::vector<double> ranges = half_circle_from(x);
  return {ranges.begin(), ranges.end()};
}

/// Ten scans a second, odometry twenty times: it stands for a second at each of four places, 0.1 m apart, and takes half a second to
/// the next.
std::vector<WrittenMessage> standing_robot() {
  const auto place = [](double t) {
    const double along = std::min(t / 1.5, 3.999), step = std::floor(along), within = 1.5 * (along - step);
    return 0.1 * (step + (within < 1.0 ? 0.0 : 2.0 * (within - 1.0)));
  };
  std::vector<WrittenMessage> out;
  for (int k = -1; k <= 112; ++k) {
    const double t = 0.05 * k, stamp = 1000.0 + t;
    out.push_back(
        {1, static_cast<std::int64_t>(1e9 * stamp), odometry(stamp, place(std::max(t, 0.0)), 0.0, 0.0)});
    if (k >= 0 && k % 2 == 0 && k < 110)
      out.push_back({0, static_cast<std::int64_t>(1e9 * stamp),
                     laser_scan(stamp, -static_cast<float>(std::numbers::pi / 2),
                                static_cast<float>(std::numbers::pi / 180), beams_from(place(t)))});
  }
  return out;
}
const std::vector<WrittenTopic> kScanAndOdometry = {{"/scan", "sensor_msgs/msg/LaserScan"},
                                                    {"/odom", "nav_msgs/msg/Odometry"}};

const std::string kFromBag = " --scan /scan --odom /odom --radius 0.12 -o ";

TEST(ExtractBags, EveryContainerGivesTheSameRecording) {
  const TemporaryFolder folder;
  const auto messages = standing_robot();
  folder.write("plain.mcap", mcap_file(kScanAndOdometry, messages, {}));
  folder.write("lz4.mcap", mcap_file(kScanAndOdometry, messages, {40, "lz4"}));
  folder.write("zstd.mcap", mcap_file(kScanAndOdometry, messages, {40, "zstd", true, true, false}));
  write_db3(folder.file("run.db3"), kScanAndOdometry, messages);
  fs::create_directory(folder.file("run"));
  fs::copy_file(folder.file("lz4.mcap"), folder.file("run/run_0.mcap"));
  folder.write("run/metadata.yaml", "rosbag2_bagfile_information:\n  relative_file_paths: [run_0.mcap]\n");
  std::string first;
  for (const char* name : {"plain.mcap", "lz4.mcap", "zstd.mcap", "run.db3", "run"}) {
    SCOPED_TRACE(name);
    const RunResult result = run("extract " + folder.file(name) + kFromBag + folder.file("rec"));
    ASSERT_EQ(result.code, 0) << result.err;
    EXPECT_EQ(result.err, "");
    EXPECT_THAT(result.out,
                AllOf(HasSubstr("told apart by standing still"), HasSubstr("4 stops, 3 landmarks")));
    const Recording recording = load_recording(folder.file("rec"));
    ASSERT_EQ(recording.stops.size(), 4u);
    for (int k = 0; k < 4; ++k)
      EXPECT_NEAR(recording.stops[static_cast<std::size_t>(k)].commanded.x_m, 0.1 * k,
                  1e-9);  // poses of /odom
    const std::string observations = slurp(folder.file("rec/observations.csv"));
    if (first.empty()) first = observations;
    EXPECT_EQ(observations, first);
  }
}

TEST(ExtractBags, SaysWhatABagHolds) {
  const TemporaryFolder folder;
  folder.write("run.mcap", mcap_file(kScanAndOdometry, standing_robot(), {40, "zstd"}));
  const RunResult result = run("extract " + folder.file("run.mcap") + " --topics");
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.out,
            "/odom: nav_msgs/Odometry, 114 messages\n/scan: sensor_msgs/LaserScan, 55 messages\n");
  EXPECT_EQ(run("extract " + folder.file("run.mcap")).code, 2);  // neither --topics nor -o
  const RunResult without_odometry =
      run("extract " + folder.file("run.mcap") + " --split scan --radius 0.12 -o " + folder.file("rec"));
  EXPECT_EQ(without_odometry.code, 2);
  EXPECT_THAT(without_odometry.err, HasSubstr("--odom"));
}

TEST(ExtractBags, ABagThatWasCutOffGivesItsFirstStops) {
  const TemporaryFolder folder;
  const std::string bytes = mcap_file(kScanAndOdometry, standing_robot(), {10, "lz4"});
  folder.write("run.mcap", bytes.substr(0, bytes.size() * 6 / 10));
  const RunResult result = run("extract " + folder.file("run.mcap") + kFromBag + folder.file("rec"));
  EXPECT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
  EXPECT_THAT(result.err,
              AllOf(HasSubstr("run.mcap: nothing is read from byte "), HasSubstr("the end is missing")));
  EXPECT_THAT(load_recording(folder.file("rec")).stops.size(), ::testing::AnyOf(2u, 3u));
}

TEST(ExtractBags, WrongInputLeavesNothingBehind) {
  const TemporaryFolder folder;
  folder.write("run.mcap", mcap_file(kScanAndOdometry, standing_robot(), {}));
  folder.write("half.db3", "SQLite format 3");
  folder.write("scans.csv", "stamp,angle_min,angle_increment,r0\n0,0,0.1,1\n");
  const auto refused = [&](const std::string& arguments, const std::string& word) {
    const RunResult result = run("extract " + arguments + " -o " + folder.file("rec"));
    EXPECT_EQ(result.code, 2) << arguments;
    EXPECT_THAT(result.err, HasSubstr(word));
    EXPECT_EQ(count_of(result.err, "\n"), 1) << result.err;
    EXPECT_FALSE(fs::exists(folder.file("rec")));
  };
  refused(folder.file("run.mcap") + " --scan /laser",
          "its topics: /odom (nav_msgs/Odometry, 114 messages), /scan");
  refused(folder.file("run.mcap") + " --frames odom,base", "--odom");
  refused(folder.file("half.db3"), "half.db3");
  refused(folder.file("scans.csv") + " --odom /odom", "is no bag, which --odom is for");

  const RunResult piped = run("extract - -o " + folder.file("rec"), slurp(folder.file("run.mcap")));
  EXPECT_EQ(piped.code, 2);
  EXPECT_THAT(piped.err, HasSubstr("stdin: is a bag of ROS 2, which is read from a file only"));
}

}  // namespace
}  // namespace rangecal::test
