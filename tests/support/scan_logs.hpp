// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

#include "ingest/bags/bag_scans.hpp"
#include "rangecal/solvers/extract/scan_source.hpp"

namespace rangecal::test {

/// What a source that nobody has read yet has, in memory.
inline ScanLog whole_log(ScanSource& source) {
  source.survey([](const Scan&) {});
  ScanLog log = source.log();
  log.scans.clear();
  source.read([&](std::size_t, const Scan& scan) { log.scans.push_back(scan); });
  return log;
}

/// A bag's scans; those that stay in memory and those that are read again have to be the same.
inline ScanLog read_bag_scans(const std::string& path, const ingest::BagChoice& choice) {
  ingest::BagScans kept(path, choice, 1'000'000), again(path, choice, 0);
  ScanLog log = whole_log(kept);
  const ScanLog other = whole_log(again);
  bool same =
      log.scans.size() == other.scans.size() && log.warning == other.warning && log.format == other.format;
  for (std::size_t i = 0; same && i < log.scans.size(); ++i) {
    const Scan &a = log.scans[i], &b = other.scans[i];
    same = a.stamp_s == b.stamp_s && a.row == b.row && a.bearing_rad == b.bearing_rad &&
           a.size() == b.size() && a.odometry.has_value() == b.odometry.has_value();
    for (std::size_t j = 0; same && j < a.size(); ++j)
      same = a.range_m[j] == b.range_m[j] || (a.range_m[j] != a.range_m[j] && b.range_m[j] != b.range_m[j]);
    if (same && a.odometry)
      same = a.odometry->x_m == b.odometry->x_m && a.odometry->y_m == b.odometry->y_m &&
             a.odometry->heading_rad == b.odometry->heading_rad;
  }
  if (!same) throw std::logic_error(path + ": scans read again differ from those kept");
  return log;
}

}  // namespace rangecal::test
