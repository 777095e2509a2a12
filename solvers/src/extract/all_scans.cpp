// SPDX-License-Identifier: BSD-3-Clause
#include "extract/all_scans.hpp"

#include <algorithm>

namespace rangecal::extract {
namespace {

Scan turned(Scan scan) {
  for (double& bearing : scan.bearing_rad) bearing = -bearing;
  std::reverse(scan.bearing_rad.begin(), scan.bearing_rad.end());
  std::reverse(scan.range_m.begin(), scan.range_m.end());
  return scan;
}

}  // namespace

void AllScans::survey(const ScanSource::Look& look) {
  for (ScanSource* source : sources_) {
    source->survey(clockwise_ ? ScanSource::Look([&](const Scan& scan) { look(turned(scan)); }) : look);
    logs_.push_back(&source->log());
    for (const Scan& head : source->log().scans) heads_.push_back(&head);
  }
}

void AllScans::read(const ScanSource::Take& take) const {
  std::size_t begin = 0;
  for (ScanSource* source : sources_) {
    source->read([&](std::size_t i, const Scan& scan) {
      if (clockwise_)
        take(begin + i, turned(scan));
      else
        take(begin + i, scan);
    });
    begin += source->log().scans.size();
  }
}

}  // namespace rangecal::extract
