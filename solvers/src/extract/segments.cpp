// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/segments.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr double kGapSteps = 2.6;  ///< up to two lost beams do not end a segment

/// A scan unrolled so that it begins at a break, lost beams included.
struct Ring {
  std::vector<Beam> beams;
  std::vector<bool> hit;
  double step = 0.0;
  bool full = false;
};

double median_step(const Scan& scan) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < scan.size(); ++i)
    steps.push_back(scan.bearing_rad[i] - scan.bearing_rad[i - 1]);
  return steps.empty() ? 0.0 : upper_median(std::move(steps));
}

/// The range at `bearing` on the straight line through two beams, and its standard deviation; false behind the sensor.
bool extrapolate(const Beam& far, const Beam& near, double bearing, const ScanNoise& noise, double& range,
                 double& sd) {
  const double base = std::sin(near.bearing_rad - far.bearing_rad);
  const double a = std::sin(bearing - far.bearing_rad) / base,
               b = -std::sin(bearing - near.bearing_rad) / base;
  const double u = a / near.range_m + b / far.range_m;
  if (!(u > 0.0)) return false;
  range = 1.0 / u;
  sd = range * range *
       std::hypot(a * noise.spread(near.range_m) / (near.range_m * near.range_m),
                  b * noise.spread(far.range_m) / (far.range_m * far.range_m));
  return true;
}

class Splitter {
 public:
  Splitter(const Ring& ring, const ScanNoise& noise, const CylinderOptions& options)
      : ring_(ring), noise_(noise), options_(options) {}

  /// True if a segment ends between beams i and j, the next hit.
  bool breaks(std::size_t i, std::size_t j) const {
    const Beam &a = at(i), &b = at(j);
    const double gap = angle(i, j);
    if (gap > kGapSteps * ring_.step) return true;
    const double least = std::min(a.range_m, b.range_m), radius = options_.largest_m();
    const double slope = std::min(radius, std::sqrt(2.0 * radius * least * gap));
    const double jump = std::abs(b.range_m - a.range_m);
    const double sigma = std::hypot(noise_.spread(a.range_m), noise_.spread(b.range_m));
    if (jump <= options_.jump_sigmas * sigma + slope) return false;
    return !on_line(i, j, true) || !on_line(i, j, false);
  }

 private:
  const Beam& at(std::size_t i) const { return ring_.beams[i % ring_.beams.size()]; }
  double angle(std::size_t i, std::size_t j) const {
    double gap = at(j).bearing_rad - at(i).bearing_rad;
    if (gap < 0.0) gap += kTurn;
    return gap;
  }
  /// True if the beam on one side lies on the line through the two on the other.
  bool on_line(std::size_t i, std::size_t j, bool from_left) const {
    const std::size_t n = ring_.beams.size();
    const std::size_t near = from_left ? i : j, target = from_left ? j : i;
    const std::size_t far = (from_left ? near + n - 1 : near + 1) % n;
    if (!ring_.hit[far] || (!ring_.full && (from_left ? near == 0 : near + 1 == n))) return false;
    const double sign = from_left ? 1.0 : -1.0;
    const Beam flat_far{-sign * (from_left ? angle(far, near) : angle(near, far)), at(far).range_m};
    if (std::abs(flat_far.bearing_rad) > kGapSteps * ring_.step) return false;
    double range = 0.0, sd = 0.0;
    if (!extrapolate(flat_far, {0.0, at(near).range_m}, sign * angle(i, j), noise_, range, sd)) return false;
    const double sigma = std::hypot(sd, noise_.spread(at(target).range_m));
    return std::abs(range - at(target).range_m) <= options_.jump_sigmas * sigma;
  }

  const Ring& ring_;
  const ScanNoise& noise_;
  const CylinderOptions& options_;
};

Ring unroll(const Scan& scan, const CylinderOptions& options, Tally& tally) {
  Ring ring;
  ring.step = median_step(scan);
  for (std::size_t i = 0; i < scan.size(); ++i) {
    const double range = scan.range_m[i];
    const bool returned = Scan::returned(range);
    const bool inside = returned && range >= options.range_min_m && range <= options.range_max_m;
    ++tally["all"];
    if (!returned) ++tally["no return"];
    if (returned && !inside) ++tally["outside the sensor's range"];
    ring.beams.push_back({scan.bearing_rad[i], range});
    ring.hit.push_back(inside);
  }
  if (scan.size() > 2) {
    const double seam = scan.bearing_rad.front() + kTurn - scan.bearing_rad.back();
    ring.full = seam > 0.2 * ring.step && seam < 2.0 * ring.step;
  }
  return ring;
}

/// Beams of the ring rotated so that a segment begins at its first beam; bearings keep increasing.
Ring rotated(const Ring& ring, std::size_t start) {
  Ring out = ring;
  const std::size_t n = ring.beams.size();
  for (std::size_t i = 0; i < n; ++i) {
    const std::size_t from = (start + i) % n;
    out.beams[i] = ring.beams[from];
    if (start + i >= n) out.beams[i].bearing_rad += kTurn;
    out.hit[i] = ring.hit[from];
  }
  return out;
}

/// The end beyond the last hit of a segment: the next beam, or the next return where up to two beams are lost.
void find_end(const Ring& ring, std::size_t last, bool right, Segment& segment) {
  const std::size_t n = ring.beams.size();
  const double here = ring.beams[last].bearing_rad, sign = right ? 1.0 : -1.0;
  double& miss = right ? segment.miss_right_rad : segment.miss_left_rad;
  miss = here + sign * ring.step;
  for (std::size_t ahead = 1; ahead <= 3; ++ahead) {
    const bool outside = right ? last + ahead >= n : ahead > last;
    if (!ring.full && outside) {
      segment.view_ends = segment.view_ends || ahead == 1;
      return;
    }
    const std::size_t i = (right ? last + ahead : last + n - ahead) % n;
    if (!ring.hit[i]) continue;
    double gap = sign * (ring.beams[i].bearing_rad - here);
    if (gap < 0.0) gap += kTurn;
    if (gap > (kGapSteps + 1.0) * ring.step) return;
    miss = here + sign * gap;
    // A beam without return between the two went past both.
    (right ? segment.nearer_right : segment.nearer_left) =
        ahead == 1 && ring.beams[i].range_m < ring.beams[last].range_m;
    return;
  }
}

}  // namespace

double CylinderOptions::largest_m() const {
  return radii_m.empty() ? radius_max_m : *std::max_element(radii_m.begin(), radii_m.end());
}

std::vector<Segment> split_scan(const Scan& scan, const ScanNoise& noise, const CylinderOptions& options,
                                Tally& beams) {
  Ring ring = unroll(scan, options, beams);
  const std::size_t n = ring.beams.size();
  if (ring.full) {  // begin where a segment ends
    const Splitter splitter(ring, noise, options);
    std::size_t start = 0;
    while (start < n && ring.hit[start] && ring.hit[(start + n - 1) % n] &&
           !splitter.breaks((start + n - 1) % n, start))
      ++start;
    if (start < n) ring = rotated(ring, start);
  }
  const Splitter splitter(ring, noise, options);
  std::vector<Segment> segments;
  std::size_t previous = n;  // the last hit, none yet
  std::size_t first = 0;
  const auto close = [&] {
    if (previous == n) return;
    find_end(ring, first, false, segments.back());
    find_end(ring, previous, true, segments.back());
  };
  for (std::size_t i = 0; i < n; ++i) {
    if (!ring.hit[i]) continue;
    if (previous == n || splitter.breaks(previous, i)) {
      close();
      segments.emplace_back();
      first = i;
    }
    segments.back().beams.push_back(ring.beams[i]);
    previous = i;
  }
  close();
  return segments;
}

}  // namespace rangecal
