// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// One sweep of a scanner: beam i points to bearing_rad[i] in the sensor frame (counter-clockwise, 0 ahead) and reads
/// range_m[i]. Beams are in the order of increasing bearing, unwrapped: bearing_rad may run from 0 to 2 pi. A beam
/// without a return is not finite or not positive. One stamp for the whole sweep.
struct Scan {
  double stamp_s = 0.0;
  std::vector<double> bearing_rad, range_m;
  std::optional<Pose2> odometry;  ///< where the log says the robot was
  std::string stop;               ///< label of the stop where the file has one, else empty
  int row = 0;                    ///< line in the file, or number of the message

  std::size_t size() const { return range_m.size(); }
  static bool returned(double range) { return std::isfinite(range) && range > 0.0; }
};

/// The scans of one file, in the order of the file.
struct ScanLog {
  std::string path, format;  ///< format in words: "CSV, one scan a line", "CARMEN log", ...
  std::vector<Scan> scans;
  int lines_skipped = 0;  ///< messages of other kinds
  /// What was left out of a file that was cut off, with file and row; empty if nothing.
  std::string warning = {};
};

}  // namespace rangecal
