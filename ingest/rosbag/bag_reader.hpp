// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

namespace rangecal::bag {

// C++17 and the standard library alone: the headers of ROS 1 do not compile as C++20, so this header is what both sides
// share.

struct Topic {
  std::string name, type;  ///< type as ROS 1 writes it: sensor_msgs/LaserScan
  std::uint64_t messages = 0;
};

struct Message {
  std::uint32_t topic = 0;  ///< its place in the list of topics
  std::int64_t log_time_ns = 0;
  std::vector<unsigned char> bytes;  ///< as ROS 1 encodes it
};

/// Sets `topics`, then gives the messages of those called one of `names` to `take`, one by one in the order of recording. Returns why
/// the bag cannot be read, then or on the way; nothing if it can. Throws only what `take` throws.
std::string read(const std::string& path, const std::vector<std::string>& names, std::vector<Topic>& topics,
                 const std::function<void(const Message&)>& take);

}  // namespace rangecal::bag
