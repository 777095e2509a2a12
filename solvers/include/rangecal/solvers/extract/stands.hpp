// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
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

/// Index ranges of the scans at which the robot stands, in the order of time. Scan k belongs to the stand of scan k - 1
/// if it shows the same as both that scan and the stand's first: by odometry where both carry it, else by the beams:
///   median |r_k(b) - r_j(b)| / sqrt(2 sigma(r)^2 + (0.35 step dr/db)^2) < still_sigmas,
/// r_j read between its beams on 1/r, where its neighbours are one surface; the second term lets the angles of the
/// beams wander by a third of their step, and the least over a common turn of up to a degree counts: cheap scanners
/// begin a scan anywhere. Scans taken within a few sigmas of a stop, on arriving or leaving, count as standing. Cost:
/// linear in the beams.
std::vector<std::vector<std::size_t>> find_stands(std::span<const Scan> scans, const ScanNoise& noise,
                                                  const StandOptions& options);

}  // namespace rangecal
