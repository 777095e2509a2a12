// SPDX-License-Identifier: BSD-3-Clause
#include "rosbag/bag_reader.hpp"

#include <fcntl.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>
#include <sensor_msgs/LaserScan.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <exception>
#include <type_traits>

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

BagScans read_here(const std::string& path, const std::string& topic) {
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

/// What one process says to the other through a pipe: the same fields in the same order.
class Pipe {
 public:
  Pipe(int end, bool writes) : end_(end), writes_(writes) {}
  bool sound() const { return sound_; }

  void take(BagScans& scans) {
    take(scans.error), take(scans.other_messages), take_list(scans.topics), take_list(scans.scans);
  }

 private:
  void bytes(void* data, std::size_t size) {
    for (std::size_t at = 0; sound_ && at < size;) {
      char* here = static_cast<char*>(data) + at;
      const ssize_t count = writes_ ? ::write(end_, here, size - at) : ::read(end_, here, size - at);
      if (count < 0 && errno == EINTR) continue;
      sound_ = count > 0;
      at += sound_ ? static_cast<std::size_t>(count) : 0;
    }
  }
  template <typename Number>
  std::enable_if_t<std::is_arithmetic_v<Number>> take(Number& number) {
    bytes(&number, sizeof number);
  }
  template <typename List>
  void take_size(List& list) {
    std::size_t size = list.size();
    take(size);
    if (!writes_) list.resize(sound_ ? size : 0);
  }
  void take(std::string& text) {
    take_size(text);
    bytes(text.data(), text.size());
  }
  void take(BagScan& scan) {
    for (double* number : {&scan.stamp_s, &scan.angle_min_rad, &scan.angle_increment_rad, &scan.range_min_m,
                           &scan.range_max_m})
      take(*number);
    take_size(scan.range_m);
    bytes(scan.range_m.data(), scan.range_m.size() * sizeof(float));
  }
  template <typename Item>
  void take_list(std::vector<Item>& list) {
    take_size(list);
    for (Item& item : list) take(item);
  }

  int end_;
  bool writes_, sound_ = true;
};

[[noreturn]] void read_for_the_other(int end, const std::string& path, const std::string& topic) {
  const int nowhere = ::open("/dev/null", O_WRONLY);
  ::dup2(nowhere, STDOUT_FILENO), ::dup2(nowhere, STDERR_FILENO);  // the library prints
#ifndef RANGECAL_FUZZING
  const rlimit memory{rlim_t{8} << 30, rlim_t{8} << 30}, seconds{600, 600};
  ::setrlimit(RLIMIT_DATA, &memory), ::setrlimit(RLIMIT_CPU, &seconds);
#endif
  BagScans scans = read_here(path, topic);
  Pipe(end, true).take(scans);
  ::_exit(0);
}

}  // namespace

// In a process of its own: the library believes what a bag says about itself, and a damaged one ends it by a
// signal.
BagScans read(const std::string& path, const std::string& topic) {
  BagScans out;
  int ends[2];
  if (::pipe2(ends, O_CLOEXEC) != 0) {
    out.error = std::strerror(errno);
    return out;
  }
  const pid_t child = ::fork();
  if (child == 0) {
    ::close(ends[0]);
    read_for_the_other(ends[1], path, topic);
  }
  ::close(ends[1]);
  Pipe pipe(ends[0], false);
  if (child > 0) pipe.take(out);
  ::close(ends[0]);
  int status = 0;
  while (child > 0 && ::waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  if (child > 0 && pipe.sound() && WIFEXITED(status) && WEXITSTATUS(status) == 0) return out;
  out = BagScans{};
  out.error =
      child < 0 ? std::string("no process could be started: ") + std::strerror(errno) : "it is damaged";
  return out;
}

}  // namespace rangecal::bag
