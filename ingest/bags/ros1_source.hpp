// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>

#include "bags/message_source.hpp"

namespace rangecal::ingest {

/// A ROS 1 bag, by Debian's rosbag library in a process of its own (rosbag/bag_reader.hpp), in the order of recording. Throws
/// InputError, also where the build has no such library.
std::unique_ptr<MessageSource> open_ros1_bag(const std::string& path);

}  // namespace rangecal::ingest
