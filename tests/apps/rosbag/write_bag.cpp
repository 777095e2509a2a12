// SPDX-License-Identifier: BSD-3-Clause
// write_bag SCANS.csv OUT.bag [TOPIC...]: the scans of a CSV file (stamp, angle_min, angle_increment, ranges...) as
// sensor_msgs/LaserScan on each topic (default /scan), before each a pose at the origin on /pose and a message of
// another kind.
#include <geometry_msgs/PoseStamped.h>
#include <rosbag/bag.h>
#include <sensor_msgs/LaserScan.h>
#include <std_msgs/String.h>

#include <cstdio>
#include <exception>
#include <fstream>
#include <limits>
#include <sstream>
#include <string>
#include <vector>

int main(int argc, char** argv) try {
  if (argc < 3) return 2;
  std::vector<std::string> topics(argv + 3, argv + argc);
  if (topics.empty()) topics.push_back("/scan");
  rosbag::Bag bag(argv[2], rosbag::bagmode::Write);
  std::ifstream csv(argv[1]);
  std::string line, field;
  std::getline(csv, line);
  while (std::getline(csv, line)) {
    std::istringstream fields(line);
    std::vector<double> values;
    while (std::getline(fields, field, ',')) values.push_back(std::stod(field));
    sensor_msgs::LaserScan scan;
    scan.header.stamp = ros::Time(values.at(0) + 1.0);
    scan.angle_min = static_cast<float>(values.at(1)),
    scan.angle_increment = static_cast<float>(values.at(2));
    scan.range_min = 0.05f, scan.range_max = 20.0f;
    scan.ranges.assign(values.begin() + 3, values.end());
    std_msgs::String other;
    other.data = "another message";
    bag.write("/other", scan.header.stamp, other);
    geometry_msgs::PoseStamped pose;
    pose.header.stamp = scan.header.stamp;
    pose.pose.orientation.w = 1.0;
    bag.write("/pose", scan.header.stamp, pose);
    for (const std::string& topic : topics) bag.write(topic, scan.header.stamp, scan);
  }
  bag.close();
  return 0;
} catch (const std::exception& error) {
  std::fprintf(stderr, "write_bag: %s\n", error.what());
  return 1;
}
