// SPDX-License-Identifier: BSD-3-Clause
#include "rosbag/bag_reader.hpp"

#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/LaserScan.h>

#include <exception>

namespace rangecal::bag {
namespace {

BagScan scan_of(const sensor_msgs::LaserScan& message, const ros::Time& recorded) {
  BagScan scan;
  scan.stamp_s = message.header.stamp.isZero() ? recorded.toSec() : message.header.stamp.toSec();
  scan.angle_min_rad = message.angle_min, scan.angle_increment_rad = message.angle_increment;
  scan.range_min_m = message.range_min, scan.range_max_m = message.range_max;
  scan.range_m.assign(message.ranges.begin(), message.ranges.end());
  return scan;
}

}  // namespace

BagScans read(const std::string& path, const std::string& topic) {
  BagScans out;
  try {
    rosbag::Bag bag(path, rosbag::bagmode::Read);
    rosbag::View scans(bag, rosbag::TypeQuery("sensor_msgs/LaserScan")), all(bag);
    for (const rosbag::ConnectionInfo* connection : scans.getConnections()) {
      bool known = false;
      for (const std::string& other : out.topics) known = known || other == connection->topic;
      if (!known) out.topics.push_back(connection->topic);
    }
    if (topic.empty() && out.topics.size() != 1) return out;
    const std::string wanted = topic.empty() ? out.topics.front() : topic;
    for (const rosbag::MessageInstance& message : scans) {
      if (message.getTopic() != wanted) continue;
      const auto scan = message.instantiate<sensor_msgs::LaserScan>();
      if (scan) out.scans.push_back(scan_of(*scan, message.getTime()));
    }
    out.other_messages = static_cast<long>(all.size()) - static_cast<long>(out.scans.size());
  } catch (const std::exception& error) {
    out.error = error.what();
  }
  return out;
}

}  // namespace rangecal::bag
