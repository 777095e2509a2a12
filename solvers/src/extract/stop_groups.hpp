// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal::extract {

/// The scans of one stop.
struct StopGroup {
  Stop stop;
  std::vector<Scan> scans;
};

/// The scans by stop. Scans of no stop are counted in `tally`. Throws InputError where scans and stops do not agree.
std::vector<StopGroup> group_by_stop(const std::vector<ScanLog>& logs, const std::vector<Stop>& stops,
                                     const ScanNoise& noise, const ExtractOptions& options, StopSplit split,
                                     Tally& tally);

/// The split that `automatic` stands for.
StopSplit resolved_split(const std::vector<ScanLog>& logs, const std::vector<Stop>& stops, StopSplit split);

}  // namespace rangecal::extract
