// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "extract/all_scans.hpp"
#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal::extract {

/// The scans of one stop, by their place among all.
struct StopGroup {
  Stop stop;
  std::vector<std::size_t> scans;
};

/// The scans by stop. Those of no stop are counted in `tally`. Throws InputError where scans and stops do not agree. Where stops are
/// stands of the robot and odometry is not with every scan, the scans are read once more.
std::vector<StopGroup> group_by_stop(const AllScans& scans, const std::vector<Stop>& stops,
                                     const ScanNoise& noise, const ExtractOptions& options, StopSplit split,
                                     Tally& tally);

/// The split that `automatic` stands for.
StopSplit resolved_split(const AllScans& scans, const std::vector<Stop>& stops, StopSplit split);

}  // namespace rangecal::extract
