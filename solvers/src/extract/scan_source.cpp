// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/scan_source.hpp"

#include <utility>

namespace rangecal {

ScansInMemory::ScansInMemory(ScanLog log) : scans_(std::move(log.scans)), heads_(std::move(log)) {
  heads_.scans.clear();
  for (const Scan& scan : scans_) heads_.scans.push_back(head_of(scan));
}

void ScansInMemory::survey(const Look& look) {
  for (const Scan& scan : scans_) look(scan);
}

void ScansInMemory::read(const Take& take) {
  for (std::size_t i = 0; i < scans_.size(); ++i) take(i, scans_[i]);
}

Scan head_of(const Scan& scan) { return {scan.stamp_s, {}, {}, scan.odometry, scan.stop, scan.row}; }

}  // namespace rangecal
