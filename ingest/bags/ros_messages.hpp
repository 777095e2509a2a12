// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal::ingest {

/// How the fields of a ROS message follow each other in its bytes.
///   cdr  of ROS 2 (OMG DDSI-RTPS 2.5, section 10.2, and CORBA 3.3 part 2, section 9.3): four bytes first, of which the
///        second is 0 for big and 1 for little endian numbers and the others are not read; every number then stands at a
///        multiple of its own size, counted from behind these four; a text is its length with a final NUL in 4 bytes, then its bytes and
///        the NUL; a list is its length in 4 bytes, then its items. What follows the last field is padding: less than 8 bytes.
///   ros1 of ROS 1 (wiki.ros.org/ROS/Technical%20Overview): the same without those four bytes, without gaps and NUL, little
///        endian; a header begins with a 4 byte number of the message.
enum class Wire { cdr, ros1 };

// The messages as common_interfaces and geometry2 define them; of each, the fields that are used. Stamps in seconds, 0 where
// nobody set them. Each read_... throws InputError, without a file's name, for bytes that end within a field or go on behind
// the last one, or hold a byte order that is neither.

/// Where numbers of a message stand in its bytes.
struct FloatPlace {
  std::size_t at = 0;
  bool swapped = false;  ///< against the order of this machine
};
/// Puts numbers there.
void put_floats(std::span<std::byte> message, const FloatPlace& place, std::span<const float> values);

/// sensor_msgs/LaserScan: header, angle_min, angle_max, angle_increment, time_increment, scan_time, range_min, range_max (all
/// float32), ranges[], intensities[] (float32).
struct LaserScanMessage {
  double stamp_s = 0.0;
  float angle_min_rad = 0.0f, angle_max_rad = 0.0f, angle_increment_rad = 0.0f;
  float range_min_m = 0.0f, range_max_m = 0.0f;
  std::vector<float> range_m, intensity;
  FloatPlace range_place;  ///< of the first range
};
LaserScanMessage read_laser_scan(std::span<const std::byte> bytes, Wire wire);

/// sensor_msgs/Range: header, radiation_type (uint8), field_of_view, min_range, max_range, range (float32). Newer releases of ROS 2
/// add a float32 `variance`, which is not read.
struct RangeMessage {
  double stamp_s = 0.0;
  unsigned char radiation_type = 0;  ///< 0: ultrasound, 1: infrared
  float field_of_view_rad = 0.0f, min_range_m = 0.0f, max_range_m = 0.0f, range_m = 0.0f;
  FloatPlace range_place;
};
RangeMessage read_range(std::span<const std::byte> bytes, Wire wire);

/// A pose in the plane at a time: x, y and the turn about z of a position and a quaternion, atan2(2 (w z + x y),
/// w^2 + x^2 - y^2 - z^2). Throws InputError, too, where one of them is not finite or the quaternion is not of length 1.
struct DatedPose {
  double stamp_s = 0.0;
  std::string parent, child;  ///< frames; PoseStamped has no child
  Pose2 pose;                 ///< T_parent_child
};
/// nav_msgs/Odometry: header, child_frame_id, pose (position, orientation, covariance[36]), twist (linear, angular,
/// covariance[36]), all float64.
DatedPose read_odometry(std::span<const std::byte> bytes, Wire wire);
/// geometry_msgs/PoseStamped: header, pose (position, orientation), float64.
DatedPose read_pose_stamped(std::span<const std::byte> bytes, Wire wire);
/// tf2_msgs/TFMessage: transforms[] of header, child_frame_id, translation, rotation, float64.
std::vector<DatedPose> read_transforms(std::span<const std::byte> bytes, Wire wire);

}  // namespace rangecal::ingest
