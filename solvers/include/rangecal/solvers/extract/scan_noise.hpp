// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <span>

#include "rangecal/core/scan.hpp"

namespace rangecal {

/// Standard deviation of one beam's range as a function of the reading r:
///   sigma(r) = sqrt(floor_m^2 + (quadratic_per_m r^2)^2)     [m]
/// the constant part (timing, millimetre output) and the part of a triangulating sensor, which grows with r^2.
struct ScanNoise {
  double floor_m = 0.002, quadratic_per_m = 0.004;
  double spread(double range_m) const;
};

/// A variance that was seen at a range, with the number of squares behind it.
struct SpreadSample {
  double range_m = 0.0, variance_m2 = 0.0, weight = 0.0;
};

/// The law through the samples: sigma^2 linear in (1, r^4), relative errors weighted by the counts, no part negative.
/// `floor_m` is the least floor. Throws std::invalid_argument for no sample.
ScanNoise fit_scan_noise(std::span<const SpreadSample> samples, double floor_m = 1e-4);

/// The law from the scans alone. On a straight wall u = 1/r obeys u(-) + u(+) = 2 cos(step) u(0) exactly, so
///   e = r^2 (u(-) + u(+) - 2 cos(step) u(0)),   var e = sigma^2 (2 + 4 cos^2(step))
/// over three neighbouring beams of even step; robust (median of |e|) in bins of range, so that edges and corners do
/// not count. Curved faces make it too large, never too small. Half of the smallest step between readings that differ
/// bounds the floor. Of more than 400 scans 200 to 400 are used, evenly spread, and all for the floor.
class ScanNoiseEstimator {
 public:
  ScanNoiseEstimator();
  ~ScanNoiseEstimator();
  void add(const Scan& scan);
  /// Throws InputError where fewer than 30 triples can be used.
  ScanNoise estimate() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace rangecal
