// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace rangecal::bag {

/// One sensor_msgs/LaserScan as it stands in the bag. C++17 and the standard library alone: the headers of ROS 1 do not
/// compile as C++20, so this header is what both sides share.
struct BagScan {
  double stamp_s = 0.0;  ///< header.stamp; the time of recording where that is 0
  double angle_min_rad = 0.0, angle_increment_rad = 0.0;
  double range_min_m = 0.0, range_max_m = 0.0;
  std::vector<float> range_m;
};

struct BagScans {
  std::vector<BagScan> scans;
  std::vector<std::string> topics;  ///< topics of LaserScan in the bag
  long other_messages = 0;
  std::string error;  ///< why the bag cannot be read; empty if it can
};

/// Scans of one topic, in the order of recording; with an empty `topic` those of the only one, and none where there are
/// several. Never throws.
BagScans read(const std::string& path, const std::string& topic);

}  // namespace rangecal::bag
