// SPDX-License-Identifier: BSD-3-Clause
#include "scan_files.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/scan_io.hpp"
#ifdef RANGECAL_WITH_ROSBAG
#include "rosbag/bag_reader.hpp"
#endif

namespace rangecal::ingest {
namespace {

bool is_bag(const std::string& path) {
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored)) return false;  // opening a pipe may take for ever
  std::string start(7, '\0');
  std::ifstream(path, std::ios::binary).read(start.data(), 7);
  return start == "#ROSBAG";
}

#ifdef RANGECAL_WITH_ROSBAG
ScanLog read_bag(const std::string& path, const std::string& topic) {
  const bag::BagScans read = bag::read(path, topic);
  if (!read.error.empty()) throw InputError(path, 0, "", "cannot be read as a ROS 1 bag: " + read.error);
  if (read.topics.empty()) throw InputError(path, 0, "", "holds no sensor_msgs/LaserScan");
  if (read.scans.empty())
    throw InputError(
        path, 0, "",
        fmt::format("choose one of its topics of scans by --topic: {}", fmt::join(read.topics, ", ")));
  ScanLog log{path, "ROS 1 bag", {}, static_cast<int>(read.other_messages)};
  for (const bag::BagScan& message : read.scans) {
    Scan scan;
    scan.stamp_s = message.stamp_s, scan.row = static_cast<int>(log.scans.size()) + 1;
    std::vector<double> ranges(message.range_m.begin(), message.range_m.end());
    for (double& range : ranges)
      if (range < message.range_min_m || range > message.range_max_m)
        range = std::numeric_limits<double>::infinity();
    set_beams(scan, message.angle_min_rad, message.angle_increment_rad, std::move(ranges), path);
    log.scans.push_back(std::move(scan));
  }
  return log;
}
#else
ScanLog read_bag(const std::string& path, const std::string&) {
  throw InputError(
      path, 0, "",
      "is a ROS 1 bag, which this build does not read: install librosbag-storage-dev and libsensor-msgs-dev and "
      "build again, or convert it to CSV");
}
#endif

}  // namespace

ScanLog read_scan_file(const std::string& path, const std::string& topic) {
  return path != "-" && is_bag(path) ? read_bag(path, topic) : read_scans(path);
}

}  // namespace rangecal::ingest
