// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

#include "rangecal/core/scan.hpp"
#include "rangecal/solvers/extract/scan_noise.hpp"

namespace rangecal {

/// How a log is split into stops.
struct StandOptions {
  int scans_min = 5;  ///< scans that a stand must have; shorter ones count as moving
  double still_sigmas =
      1.5;  ///< median |change of a beam| in its sigmas above which something moved (noise: 0.67)
  double move_m = 0.005;    ///< odometry: the robot stands below this and
  double turn_rad = 0.005;  ///< this, from the first scan of the stand
};

/// The scans at which the robot stands, in the order of time. Scan k belongs to the stand of scan k - 1 if it shows the same as both
/// that scan and the stand's first: by odometry where both carry it, else by the beams:
///   median |r_k(b) - r_j(b)| / sqrt(2 sigma(r)^2 + (0.35 step dr/db)^2) < still_sigmas,
/// r_j read between its beams on 1/r, where its neighbours are one surface; the second term lets the angles of the
/// beams wander by a third of their step, and the least over a common turn of up to a degree counts: cheap scanners
/// begin a scan anywhere. Scans taken within a few sigmas of a stop, on arriving or leaving, count as standing. Cost:
/// linear in the beams; memory: three scans.
class StandFinder {
 public:
  StandFinder(const ScanNoise& noise, const StandOptions& options) : noise_(noise), options_(options) {}
  /// The next scan; without beams where all have odometry.
  void add(const Scan& scan);
  /// The indices of the scans of each stand, from 0 for the first that was added.
  std::vector<std::vector<std::size_t>> stands() &&;

 private:
  void close();

  ScanNoise noise_;
  StandOptions options_;
  std::size_t count_ = 0;
  Scan first_, last_;  ///< of the stand that goes on
  std::vector<std::size_t> current_;
  std::vector<std::vector<std::size_t>> stands_;
};

}  // namespace rangecal
