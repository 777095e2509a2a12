// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal::extract {

/// The scans of one stop, which stay in their logs: those of a long bag are most of the memory that it takes.
struct StopGroup {
  Stop stop;
  std::vector<const Scan*> scans;
};

/// The scans of several logs in one list: of a single log its own, else copies in `joined`.
std::span<const Scan> scans_of(const std::vector<ScanLog>& logs, std::vector<Scan>& joined);

/// The scans by stop; `logs` must outlive what is returned. Scans of no stop are counted in `tally`. Throws InputError where scans and stops do not agree.
std::vector<StopGroup> group_by_stop(const std::vector<ScanLog>& logs, const std::vector<Stop>& stops,
                                     const ScanNoise& noise, const ExtractOptions& options, StopSplit split,
                                     Tally& tally);

/// The split that `automatic` stands for.
StopSplit resolved_split(const std::vector<ScanLog>& logs, const std::vector<Stop>& stops, StopSplit split);

}  // namespace rangecal::extract
