// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/core/scan.hpp"

namespace rangecal::ingest {

/// A file of scans of any kind: read_scans (`-` is stdin), and ROS 1 bags where the build has Debian's rosbag library.
/// `topic`: of a bag, empty for the only one. Readings outside a message's own limits are no returns. Throws InputError.
ScanLog read_scan_file(const std::string& path, const std::string& topic);

}  // namespace rangecal::ingest
