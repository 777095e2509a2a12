// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "bags/bag_scans.hpp"
#include "rangecal/solvers/extract/scan_source.hpp"

namespace rangecal::ingest {

/// A file of scans of any kind: text, which is read now (read_scans; `-` is stdin), or a bag (BagScans), of which `choice` says what
/// is read and which may keep so many beams. Throws InputError.
std::unique_ptr<ScanSource> open_scan_file(const std::string& path, const BagChoice& choice,
                                           std::size_t beams_kept);

/// The files that stand behind these names: stdin for `-`, those of a rosbag2 folder beside the folder.
std::vector<std::string> files_behind(const std::vector<std::string>& names);

}  // namespace rangecal::ingest
