// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <functional>
#include <memory>
#include <string>

#include "rangecal/solvers/extract/scan_source.hpp"

namespace rangecal::ingest {

/// What of a bag is asked for.
struct BagChoice {
  std::string scan;  ///< topic of sensor_msgs/LaserScan; empty: the only one
  std::string
      odometry;  ///< topic of nav_msgs/Odometry, geometry_msgs/PoseStamped or tf2_msgs/TFMessage; empty: none
  std::string
      frames;  ///< of a TFMessage, "PARENT,CHILD"; empty: the only pair, or odom to base_footprint or base_link
  std::function<void(double share)> progress;  ///< of the bag that is read, 0 to 1; may be empty
};

/// The scans of a bag of any kind (message_source.hpp), with the odometry at the time of each: between the messages before and after,
/// both within a second, linear in x, y and the shorter turn. A scan that has none is left out. Times are header.stamp, or the
/// time of recording where nobody set it. Readings outside a message's own limits are no returns. ScanLog::warning says in one line what
/// was lost and left out. The survey throws InputError: one that names the topics where the choice among them is not clear. Memory:
/// times and poses, and one chunk or message of the bag; beams where there are few of them, else the bag is read again for each
/// read().
class BagScans final : public ScanSource {
 public:
  /// `beams_kept`: up to so many beams stay in memory, of 16 bytes each.
  BagScans(std::string path, BagChoice choice, std::size_t beams_kept);
  ~BagScans() override;
  void survey(const Look& look) override;
  const ScanLog& log() const override;
  void read(const Take& take) override;

 private:
  class Reader;
  std::unique_ptr<Reader> reader_;
};

/// The topics of a bag with type and number of messages, one a line, and a line about what could not be read.
std::string describe_topics(const std::string& path);

}  // namespace rangecal::ingest
