// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "bags/bag_scans.hpp"
#include "rangecal/core/scan.hpp"

namespace rangecal::ingest {

/// A file of scans of any kind: text (read_scans; `-` is stdin), or a bag (read_bag_scans), of which `choice` says what is read.
/// Throws InputError.
ScanLog read_scan_file(const std::string& path, const BagChoice& choice);

/// The files that stand behind these names: stdin for `-`, those of a rosbag2 folder beside the folder.
std::vector<std::string> files_behind(const std::vector<std::string>& names);

}  // namespace rangecal::ingest
