// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/stands.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

constexpr double kJitter =
    0.35;  ///< of a step between beams, by which their angles may wander from scan to scan
constexpr double kLargestTurn = 0.0175;  ///< by which a scan as a whole may be turned [rad]
constexpr int kTurns = 4;

/// A reading and how far it may be off [m].
struct Between {
  double range_m = std::numeric_limits<double>::quiet_NaN(), slack_m = 0.0;
};

/// The reading of the scan at a bearing between two of its beams that see one surface; NaN elsewhere.
Between read_between(const Scan& scan, std::size_t& hint, double bearing, const ScanNoise& noise) {
  while (hint + 1 < scan.size() && scan.bearing_rad[hint + 1] < bearing) ++hint;
  if (hint + 1 >= scan.size() || scan.bearing_rad[hint] > bearing) return {};
  const double a = scan.range_m[hint], b = scan.range_m[hint + 1];
  const double step = scan.bearing_rad[hint + 1] - scan.bearing_rad[hint];
  if (!Scan::returned(a) || !Scan::returned(b) || !(step > 0.0)) return {};
  if (std::abs(a - b) > 5.0 * noise.spread(std::min(a, b)) + 2.0 * step * std::min(a, b)) return {};
  const double share = (bearing - scan.bearing_rad[hint]) / step;
  return {1.0 / ((1.0 - share) / a + share / b), kJitter * std::abs(b - a)};
}

/// Median change of a beam in its standard deviations, the scan turned; infinity where fewer than ten can be compared.
double turned_change(const Scan& scan, const Scan& other, double turn, const ScanNoise& noise) {
  std::vector<double> sizes;
  std::size_t hint = 0;
  for (std::size_t i = 0; i < scan.size(); ++i) {
    if (!Scan::returned(scan.range_m[i])) continue;
    const Between before = read_between(other, hint, scan.bearing_rad[i] + turn, noise);
    if (!Scan::returned(before.range_m)) continue;
    const double sigma = std::hypot(std::numbers::sqrt2 * noise.spread(before.range_m), before.slack_m);
    sizes.push_back(std::abs(scan.range_m[i] - before.range_m) / sigma);
  }
  if (sizes.size() < 10) return std::numeric_limits<double>::infinity();
  return upper_median(std::move(sizes));
}

/// The least of it over turns of up to kLargestTurn.
double change(const Scan& scan, const Scan& other, const ScanNoise& noise) {
  double least = turned_change(scan, other, 0.0, noise);
  for (int i = 1; i <= kTurns; ++i)
    for (const double sign : {-1.0, 1.0})
      least = std::min(least, turned_change(scan, other, sign * kLargestTurn * i / kTurns, noise));
  return least;
}

bool same_place(const Scan& scan, const Scan& other, const ScanNoise& noise, const StandOptions& options) {
  if (scan.odometry && other.odometry) {
    const Pose2 &a = *scan.odometry, &b = *other.odometry;
    return std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) < options.move_m &&
           std::abs(wrap_angle(a.heading_rad - b.heading_rad)) < options.turn_rad;
  }
  return change(scan, other, noise) < options.still_sigmas;
}

}  // namespace

void StandFinder::add(const Scan& scan) {
  const bool stays = !current_.empty() && same_place(scan, last_, noise_, options_) &&
                     same_place(scan, first_, noise_, options_);
  if (!stays) {
    close();
    first_ = scan;
  }
  current_.push_back(count_++);
  last_ = scan;
}

void StandFinder::close() {
  if (static_cast<int>(current_.size()) >= options_.scans_min) stands_.push_back(current_);
  current_.clear();
}

std::vector<std::vector<std::size_t>> StandFinder::stands() && {
  close();
  return std::move(stands_);
}

}  // namespace rangecal
