// SPDX-License-Identifier: BSD-3-Clause
#include "bags/ros_messages.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "support/bag_writers.hpp"

namespace rangecal::ingest {
namespace {

using test::Form;
using test::MessageWriter;
using ::testing::HasSubstr;

std::span<const std::byte> bytes_of(const std::string& text) { return std::as_bytes(std::span(text)); }
std::string from_hex(const std::string& digits) {
  std::string out;
  std::string pair;
  for (const char c : digits) {
    if (c == ' ') continue;
    pair += c;
    if (pair.size() == 2) out += static_cast<char>(std::stoi(pair, nullptr, 16)), pair.clear();
  }
  return out;
}
Wire wire_of(Form form) { return form == Form::ros1 ? Wire::ros1 : Wire::cdr; }

// A PoseStamped by hand. Places count from behind the four bytes of the CDR header: sec 0-3, nanosec 4-7, the frame's length
// 8-11, "map" and NUL 12-15; the first double needs a multiple of 8: 16. 1.5 is 3ff8000000000000, -2 is c000000000000000, 1 is
// 3ff0000000000000.
TEST(RosMessages, APoseByHandInBothByteOrders) {
  const std::string zero = " 0000000000000000";
  const std::string little =
      from_hex("00010000 02000000 0065cd1d 04000000 6d617000" + std::string() +
               " 000000000000f83f 00000000000000c0" + zero + zero + zero + zero + " 000000000000f03f");
  const std::string big =
      from_hex("00000000 00000002 1dcd6500 00000004 6d617000 3ff8000000000000 c000000000000000" + zero +
               zero + zero + zero + " 3ff0000000000000");
  for (const std::string& bytes : {little, big}) {
    const DatedPose found = read_pose_stamped(bytes_of(bytes), Wire::cdr);
    EXPECT_DOUBLE_EQ(found.stamp_s, 2.5);  // 2 s and 0x1dcd6500 = 500,000,000 ns
    EXPECT_EQ(found.parent, "map");
    EXPECT_EQ(found.pose.x_m, 1.5);
    EXPECT_EQ(found.pose.y_m, -2.0);
    EXPECT_EQ(found.pose.heading_rad, 0.0);
  }
}

// A frame of four letters and NUL ends at 17: seven bytes up to 24, where the double stands.
TEST(RosMessages, ADoubleBehindATextStandsAtAMultipleOfEight) {
  const std::string zero = " 0000000000000000";
  const std::string bytes = from_hex(
      "00010000 00000000 00000000 05000000 6f646f6d 00 ffffffffffffff 000000000000f83f 00000000000000c0" +
      zero + zero + zero + zero + " 000000000000f03f");
  const DatedPose found = read_pose_stamped(bytes_of(bytes), Wire::cdr);
  EXPECT_EQ(found.parent, "odom");
  EXPECT_EQ(found.pose.x_m, 1.5);
  EXPECT_EQ(found.pose.y_m, -2.0);
}

// In ROS 1 the same has a number first, and neither NUL nor gap.
TEST(RosMessages, APoseOfRos1ByHand) {
  const std::string zero = " 0000000000000000";
  const std::string bytes =
      from_hex("07000000 02000000 0065cd1d 03000000 6d6170 000000000000f83f 00000000000000c0" + zero + zero +
               zero + zero + " 000000000000f03f");
  const DatedPose found = read_pose_stamped(bytes_of(bytes), Wire::ros1);
  EXPECT_DOUBLE_EQ(found.stamp_s, 2.5);
  EXPECT_EQ(found.parent, "map");
  EXPECT_EQ(found.pose.x_m, 1.5);
}

class RosMessagesInForm : public ::testing::TestWithParam<Form> {};

TEST_P(RosMessagesInForm, ReadAsTheyWereWritten) {
  const Form form = GetParam();
  const Wire wire = wire_of(form);
  const std::vector<float> ranges{1.25f, INFINITY, 0.5f};
  const LaserScanMessage scan =
      read_laser_scan(bytes_of(test::laser_scan(12.25, -0.5f, 0.25f, ranges, form)), wire);
  EXPECT_DOUBLE_EQ(scan.stamp_s, 12.25);
  EXPECT_EQ(scan.angle_min_rad, -0.5f);
  EXPECT_EQ(scan.angle_max_rad, 0.0f);
  EXPECT_EQ(scan.angle_increment_rad, 0.25f);
  EXPECT_EQ(scan.range_min_m, 0.05f);
  EXPECT_EQ(scan.range_max_m, 20.0f);
  EXPECT_EQ(scan.range_m, ranges);
  EXPECT_EQ(scan.intensity, std::vector<float>(3, 47.0f));

  MessageWriter range(form);
  range.header(3.0, "sonar").put(std::uint8_t{1}).put(0.5f).put(0.25f).put(4.0f).put(1.75f);
  const RangeMessage one = read_range(bytes_of(range.bytes()), wire);
  EXPECT_EQ(one.stamp_s, 3.0);
  EXPECT_EQ(one.radiation_type, 1);
  EXPECT_EQ(one.field_of_view_rad, 0.5f);
  EXPECT_EQ(one.min_range_m, 0.25f);
  EXPECT_EQ(one.max_range_m, 4.0f);
  EXPECT_EQ(one.range_m, 1.75f);
  range.put(0.01f);  // a variance
  EXPECT_EQ(read_range(bytes_of(range.bytes()), wire).range_m, 1.75f);

  const DatedPose odometry = read_odometry(bytes_of(test::odometry(4.5, 1.0, -2.0, 2.5, form)), wire);
  EXPECT_EQ(odometry.parent, "odom");
  EXPECT_EQ(odometry.child, "base_link");
  EXPECT_EQ(odometry.pose.x_m, 1.0);
  EXPECT_EQ(odometry.pose.y_m, -2.0);
  EXPECT_NEAR(odometry.pose.heading_rad, 2.5, 1e-15);  // rounding of sin, cos and atan2

  MessageWriter transforms(form);
  transforms.put(std::uint32_t{2});
  transforms.header(1.0, "odom")
      .text("base")
      .pose(1, 2, -0.5)
      .header(1.5, "base")
      .text("laser")
      .pose(0.1, 0, 3.0);
  const auto both = read_transforms(bytes_of(transforms.bytes()), wire);
  ASSERT_EQ(both.size(), 2u);
  EXPECT_EQ(both[1].parent, "base");
  EXPECT_EQ(both[1].child, "laser");
  EXPECT_EQ(both[1].stamp_s, 1.5);
  EXPECT_EQ(both[1].pose.x_m, 0.1);
  EXPECT_NEAR(both[1].pose.heading_rad, 3.0, 1e-15);
}

TEST_P(RosMessagesInForm, EndAnywhereIsSaid) {
  const Form form = GetParam();
  const Wire wire = wire_of(form);
  const std::string scan = test::laser_scan(1.0, 0.0f, 0.1f, {1.0f, 2.0f}, form);
  const std::string odometry = test::odometry(1.0, 0, 0, 0, form);
  for (std::size_t cut = 0; cut < scan.size(); ++cut)
    EXPECT_THROW(read_laser_scan(bytes_of(scan.substr(0, cut)), wire), InputError) << cut;
  for (std::size_t cut = 0; cut < odometry.size(); ++cut)
    EXPECT_THROW(read_odometry(bytes_of(odometry.substr(0, cut)), wire), InputError) << cut;
  EXPECT_NO_THROW(read_laser_scan(bytes_of(scan + std::string(7, '\0')), wire));
  EXPECT_THROW(read_laser_scan(bytes_of(scan + std::string(8, '\0')), wire), InputError);
}

INSTANTIATE_TEST_SUITE_P(Each, RosMessagesInForm, ::testing::Values(Form::little, Form::big, Form::ros1));

TEST(RosMessages, WhatIsNoMessageIsRefused) {
  const auto refused = [](const std::string& bytes, const std::string& word) {
    try {
      read_pose_stamped(bytes_of(bytes), Wire::cdr);
      ADD_FAILURE() << word;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(word));
    }
  };
  std::string bytes = test::pose_stamped(1, 2, 3, 0);
  bytes[1] = 3;
  refused(bytes, "kind 3");
  refused(test::compressed(bytes, "zstd"), "compression_mode: MESSAGE");
  refused("", "no CDR header");
  refused(MessageWriter().header(1, "map").put(NAN).bytes(), "pose.position");
  refused(test::pose_stamped(1, NAN, 0, 0), "not finite");
  refused(MessageWriter().header(1, "map").doubles(7).bytes(), "quaternion");
  // 2^32 - 1 letters, or 2^30 transforms, are announced and not there
  refused(std::string("\0\1\0\0", 4) + std::string(8, '\0') + "\xff\xff\xff\xff", "header.frame_id");
  EXPECT_THROW(read_transforms(bytes_of(std::string("\0\1\0\0\0\0\0\x40", 8)), Wire::cdr), InputError);
}

}  // namespace
}  // namespace rangecal::ingest
