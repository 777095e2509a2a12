// SPDX-License-Identifier: BSD-3-Clause
#include "bags/bag_scans.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "bags/bag_folder.hpp"
#include "rangecal/core/errors.hpp"
#include "support/bag_writers.hpp"
#include "support/recordings.hpp"
#include "support/scan_logs.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::ingest {
namespace {

using test::Form;
using test::MessageWriter;
using test::read_bag_scans;
using test::TemporaryFolder;
using test::WrittenMessage;
using test::WrittenTopic;
using ::testing::AllOf;
using ::testing::HasSubstr;

const std::vector<WrittenTopic> kRobot = {{"/scan", "sensor_msgs/msg/LaserScan"},
                                          {"/odom", "nav_msgs/msg/Odometry"},
                                          {"/tf", "tf2_msgs/msg/TFMessage"},
                                          {"/sonar", "sensor_msgs/msg/Range"},
                                          {"/pose", "geometry_msgs/msg/PoseStamped"}};

std::int64_t nanoseconds(double seconds) { return std::llround(1e9 * seconds); }

/// A scan each second from 10 to 14; odometry each second from 10.25 on along x, turning through the half circle.
std::vector<WrittenMessage> five_scans(Form form = Form::little) {
  std::vector<WrittenMessage> out;
  for (int i = 0; i < 5; ++i) {
    const double t = 10.0 + i, heading = std::numbers::pi - 0.4 + 0.2 * i;
    out.push_back({0, nanoseconds(t),
                   test::laser_scan(t, -0.5f, 0.25f, {1.0f + static_cast<float>(i), 0.01f, 30.0f}, form)});
    out.push_back({1, nanoseconds(t), test::odometry(t + 0.25, i, 2.0, heading, form)});
    MessageWriter transforms(form);
    transforms.put(std::uint32_t{2}).header(t + 0.25, "odom").text("base").pose(i, 2.0, heading);
    transforms.header(t + 0.25, "base").text("laser").pose(0.1, 0.0, 0.0);
    out.push_back({2, nanoseconds(t), transforms.bytes()});
    out.push_back({3, nanoseconds(t),
                   MessageWriter(form)
                       .header(t, "s")
                       .put(std::uint8_t{0})
                       .put(0.1f)
                       .put(0.1f)
                       .put(4.0f)
                       .put(1.0f)
                       .bytes()});
    out.push_back({4, nanoseconds(t), test::pose_stamped(t + 0.25, i, 2.0, heading, form)});
  }
  return out;
}

BagChoice chosen(const std::string& scan, const std::string& odometry = "", const std::string& frames = "") {
  return {scan, odometry, frames, {}};
}

class ScansOfBags : public ::testing::Test {
 protected:
  std::string write_mcap(const std::vector<WrittenMessage>& messages, const test::McapForm& form = {}) {
    folder_.write("run.mcap", test::mcap_file(kRobot, messages, form));
    return folder_.file("run.mcap");
  }
  void expect_refused(const std::string& path, const BagChoice& choice, const std::string& word) {
    try {
      read_bag_scans(path, choice);
      ADD_FAILURE() << "taken: " << word;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr(path), HasSubstr(word), Not(HasSubstr("\n"))));
    }
  }
  TemporaryFolder folder_;
};

TEST_F(ScansOfBags, AreTheSameOfEveryContainerAndByteOrder) {
  for (const Form form : {Form::little, Form::big}) {
    const auto messages = five_scans(form);
    test::write_db3(folder_.file("run.db3"), kRobot, messages);
    for (const std::string& path : {write_mcap(messages), folder_.file("run.db3")}) {
      const ScanLog log = read_bag_scans(path, chosen(""));  // the only topic of scans
      ASSERT_EQ(log.scans.size(), 5u) << path;
      const Scan& third = log.scans[2];
      EXPECT_EQ(third.stamp_s, 12.0);
      EXPECT_EQ(third.row, 3);
      EXPECT_EQ(third.bearing_rad, (std::vector<double>{-0.5, -0.25, 0.0}));
      EXPECT_EQ(third.range_m[0], 3.0);
      EXPECT_FALSE(Scan::returned(third.range_m[1]));  // below range_min
      EXPECT_FALSE(Scan::returned(third.range_m[2]));  // beyond range_max
      EXPECT_FALSE(third.odometry);
      EXPECT_EQ(log.warning, "");
    }
    std::filesystem::remove(folder_.file("run.db3"));
  }
}

// At 11 s the odometry of 10.25 s and 11.25 s counts 1/4 and 3/4: x = 0.75; at 13 s the heading runs over from pi + 0 to pi + 0.2,
// of which it is pi + 0.15 = -pi + 0.15. The scan of 10 s has none before it.
TEST_F(ScansOfBags, OdometryIsReadBetweenItsMessages) {
  const std::string path = write_mcap(five_scans());
  for (const auto& [topic, frames] : {std::pair{"/odom", ""}, {"/pose", ""}, {"/tf", "odom,base"}}) {
    SCOPED_TRACE(topic);
    const ScanLog log = read_bag_scans(path, chosen("/scan", topic, frames));
    ASSERT_EQ(log.scans.size(), 4u);
    EXPECT_THAT(log.warning, HasSubstr("1 of 5 scans do not lie between two messages of"));
    EXPECT_NEAR(log.scans[0].odometry->x_m, 0.75, 1e-6);  // the stamps are rounded: 2e-7 s
    EXPECT_NEAR(log.scans[0].odometry->y_m, 2.0, 1e-12);
    EXPECT_NEAR(log.scans[2].odometry->heading_rad, -std::numbers::pi + 0.15, 1e-6);
  }
}

TEST_F(ScansOfBags, ScansFarFromOdometryAreLeftOut) {
  std::vector<WrittenMessage> messages;
  for (const double t : {0.0, 3.0, 3.5})
    messages.push_back({1, nanoseconds(t), test::odometry(100 + t, t, 0, 0)});
  for (const double t : {1.0, 3.25, 9.0})
    messages.push_back({0, nanoseconds(t), test::laser_scan(100 + t, 0, 0.1f, {1, 2})});
  const ScanLog log = read_bag_scans(write_mcap(messages), chosen("/scan", "/odom"));
  ASSERT_EQ(log.scans.size(), 1u);
  EXPECT_EQ(log.scans[0].odometry->x_m, 3.25);
  EXPECT_THAT(log.warning, HasSubstr("2 of 3 scans"));
  messages.erase(messages.begin() + 4);
  expect_refused(write_mcap(messages), chosen("/scan", "/odom"),
                 "no scan lies between two messages of /odom");
}

TEST_F(ScansOfBags, AStampThatNobodySetIsTheTimeOfRecording) {
  const ScanLog log = read_bag_scans(
      write_mcap({{0, nanoseconds(5.5), test::laser_scan(0.0, 0, 0.1f, {1, 2})}}), chosen("/scan"));
  EXPECT_EQ(log.scans.at(0).stamp_s, 5.5);
}

TEST_F(ScansOfBags, WhatIsNotClearIsAskedFor) {
  const std::string path = write_mcap(five_scans());
  expect_refused(path, chosen("/scam"), "its topics: /odom (nav_msgs/Odometry, 5 messages), /pose");
  expect_refused(path, chosen("/odom"), "topic /odom is of nav_msgs/Odometry, not of sensor_msgs/LaserScan");
  expect_refused(path, chosen("/sonar"), "single distances");
  expect_refused(path, chosen("/scan", "/sonar"), "odometry is nav_msgs/Odometry");
  expect_refused(path, chosen("/scan", "/odometry"), "holds no readable message of /odometry (--odom)");
  expect_refused(path, chosen("/scan", "/tf"), "--frames PARENT,CHILD, one of: base,laser  odom,base");
  expect_refused(path, chosen("/scan", "/tf", "map,odom"), "one of: base,laser  odom,base");
  const std::vector<WrittenTopic> two = {{"/front", "sensor_msgs/msg/LaserScan"},
                                         {"/rear", "sensor_msgs/msg/LaserScan"}};
  folder_.write("two.mcap", test::mcap_file(two, {{0, 1, test::laser_scan(1, 0, 0.1f, {1, 2})}}, {}));
  expect_refused(folder_.file("two.mcap"), chosen(""),
                 "choose one of its topics of scans by --scan: /front, /rear");
  folder_.write("json.mcap",
                test::mcap_file({{"/scan", "sensor_msgs/msg/LaserScan", "json"}}, {{0, 1, "{}"}}, {}));
  expect_refused(folder_.file("json.mcap"), chosen("/scan"), "encoded as 'json'");
  folder_.write("text.mcap", "not a bag at all");
  expect_refused(folder_.file("text.mcap"), chosen(""), "is no bag");
  expect_refused(folder_.file("none.mcap"), chosen(""), "no such file");
  folder_.write("packed.zstd", test::compressed("bag", "zstd"));
  expect_refused(folder_.file("packed.zstd"), chosen(""), "zstd -d");
}

TEST_F(ScansOfBags, MessagesThatCannotBeUsedAreCounted) {
  auto messages = five_scans();
  messages[5].bytes.resize(30);                                        // the second scan ends early
  messages[10].bytes = test::laser_scan(12.0, 0.0f, 2.0f, {1, 2, 3});  // degrees
  const ScanLog log = read_bag_scans(write_mcap(messages), chosen("/scan"));
  EXPECT_EQ(log.scans.size(), 3u);
  EXPECT_THAT(log.warning,
              HasSubstr("2 messages of /scan cannot be used and are left out (the first: it ends within"));
}

TEST_F(ScansOfBags, MessagesOfRos1InAnMcapAreRead) {
  folder_.write("run.mcap",
                test::mcap_file({{"/scan", "sensor_msgs/LaserScan", "ros1"}},
                                {{0, 1, test::laser_scan(1.5, 0, 0.1f, {1, 2}, Form::ros1)}}, {}));
  EXPECT_EQ(read_bag_scans(folder_.file("run.mcap"), chosen("")).scans.at(0).stamp_s, 1.5);
}

TEST_F(ScansOfBags, AFolderIsReadByItsMetadata) {
  const auto messages = five_scans();
  const auto part = [&](const std::string& name, std::size_t from, std::size_t to) {
    folder_.write(name, test::mcap_file(kRobot,
                                        {messages.begin() + static_cast<std::ptrdiff_t>(from),
                                         messages.begin() + static_cast<std::ptrdiff_t>(to)},
                                        {}));
  };
  part("run_10.mcap", 15, 25), part("run_2.mcap", 0, 15);
  const auto stamps = [&] {
    std::vector<double> out;
    for (const Scan& scan : read_bag_scans(folder_.path(), chosen("/scan")).scans)
      out.push_back(scan.stamp_s);
    return out;
  };
  const std::vector<double> in_order{10, 11, 12, 13, 14};
  EXPECT_EQ(stamps(), in_order);  // by the numbers in the names
  const std::string head =
      "rosbag2_bagfile_information:\n  version: 5\n  custom_data: ~\n  relative_file_paths:\n";
  folder_.write("metadata.yaml", head + "    - run_10.mcap\n    - old_name/run_2.mcap\n");
  EXPECT_EQ(stamps(), (std::vector<double>{13, 14, 10, 11, 12}));
  folder_.write("metadata.yaml", head + "    - run_2.mcap\n    - run_10.mcap\n    - run_11.mcap\n");
  const ScanLog log = read_bag_scans(folder_.path(), chosen("/scan"));
  EXPECT_EQ(log.scans.size(), 5u);
  EXPECT_THAT(log.warning, HasSubstr("run_11.mcap cannot be opened"));
  for (const char* names : {"/etc/passwd", "..", "run_2.mcap\n    - run_2.mcap"}) {
    folder_.write("metadata.yaml", head + "    - " + names + "\n");
    EXPECT_THROW(read_bag_scans(folder_.path(), chosen("/scan")), InputError) << names;
  }
  const TemporaryFolder empty;
  expect_refused(empty.path(), chosen(""), "a folder without metadata.yaml");
}

TEST_F(ScansOfBags, TopicsAreListed) {
  EXPECT_EQ(describe_topics(write_mcap(five_scans())),
            "/odom: nav_msgs/Odometry, 5 messages\n/pose: geometry_msgs/PoseStamped, 5 messages\n"
            "/scan: sensor_msgs/LaserScan, 5 messages\n/sonar: sensor_msgs/Range, 5 messages\n"
            "/tf: tf2_msgs/TFMessage, 5 messages\n");
}

// Recorded by rosbag2 with libmcap 1.3.1; the number of messages is that of metadata.yaml. The first and last scans were decoded by
// Python's struct.
TEST_F(ScansOfBags, OfARealRecordingAreThoseOfAnotherDecoder) {
  const std::string folder = testing::recordings() + "/ros2-bags";
  RANGECAL_REQUIRE_RECORDING(folder);
  struct Expected {
    const char* file;
    std::size_t scans, beams;
    double stamp_s, angle_min_rad, first_m;
  };
  for (const Expected& e :
       {Expected{"wall_0.5m.mcap", 289, 246, 1771269759.60029, 0.006684824358671904, 0.503000020980835},
        Expected{"wall_2m.mcap", 311, 240, 1771270852.3503032, 0.007655514869838953, 2.006999969482422}}) {
    SCOPED_TRACE(e.file);
    const ScanLog log = read_bag_scans(folder + "/" + e.file, chosen(""));
    ASSERT_EQ(log.scans.size(), e.scans);
    EXPECT_EQ(log.scans[0].size(), e.beams);
    EXPECT_NEAR(log.scans[0].stamp_s, e.stamp_s, 1e-6);  // printed with 5 digits of a second
    EXPECT_EQ(log.scans[0].bearing_rad[0], e.angle_min_rad);
    EXPECT_EQ(log.scans[0].range_m[0], e.first_m);
  }
}

}  // namespace
}  // namespace rangecal::ingest
