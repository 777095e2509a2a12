// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/scan_noise.hpp"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>
#include <vector>

#include "extract/thinned.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace extract {

/// Three neighbouring beams on a wall.
struct Triple {
  double range_m, error_m;  ///< error_m is scaled to the sigma of one beam
};

}  // namespace extract

namespace {

using extract::Triple;

constexpr double coarsest_m = 0.01;  ///< of the resolutions that an output may have
constexpr double kMadToSigma = 1.0 / median_of_normal_size;

std::vector<Triple> triples_of(const Scan& scan) {
  std::vector<Triple> triples;
  for (std::size_t i = 1; i + 1 < scan.size(); ++i) {
    const double before = scan.range_m[i - 1], here = scan.range_m[i], after = scan.range_m[i + 1];
    if (!Scan::returned(before) || !Scan::returned(here) || !Scan::returned(after)) continue;
    const double left = scan.bearing_rad[i] - scan.bearing_rad[i - 1];
    const double right = scan.bearing_rad[i + 1] - scan.bearing_rad[i];
    if (std::abs(left - right) > 0.05 * std::abs(left)) continue;
    const double c = std::cos(left);
    const double error = here * here * (1.0 / before + 1.0 / after - 2.0 * c / here);
    triples.push_back({here, error / std::sqrt(2.0 + 4.0 * c * c)});
  }
  return triples;
}

/// The smallest difference [m] between neighbouring readings of the scan that differ, or `least`.
double resolution_m(const Scan& scan, double least) {
  for (std::size_t i = 1; i < scan.size(); ++i) {
    const double step = std::abs(scan.range_m[i] - scan.range_m[i - 1]);
    if (step > 1e-6 && step < least) least = step;
  }
  return least;
}

}  // namespace

double ScanNoise::spread(double range_m) const {
  return std::hypot(floor_m, quadratic_per_m * range_m * range_m);
}

ScanNoise fit_scan_noise(std::span<const SpreadSample> samples, double floor_m) {
  if (samples.empty()) throw std::invalid_argument("fit_scan_noise: no sample");
  // Least squares of v = a + b r^4 with weights count / v^2: a sample variance scatters in proportion to itself.
  double s0 = 0.0, s4 = 0.0, s8 = 0.0, v0 = 0.0, v4 = 0.0;
  for (const SpreadSample& sample : samples) {
    const double v = std::max(sample.variance_m2, 1e-12), w = sample.weight / (v * v);
    const double r4 = std::pow(sample.range_m, 4);
    s0 += w, s4 += w * r4, s8 += w * r4 * r4, v0 += w * v, v4 += w * r4 * v;
  }
  const double determinant = s0 * s8 - s4 * s4;
  double a = v0 / s0, b = 0.0;
  if (determinant > 1e-9 * s0 * s8)
    a = (s8 * v0 - s4 * v4) / determinant, b = (s0 * v4 - s4 * v0) / determinant;
  if (b < 0.0) a = v0 / s0, b = 0.0;
  if (a < 0.0) a = 0.0, b = v4 / s8;
  return {std::max(std::sqrt(a), floor_m), std::sqrt(b)};
}

struct ScanNoiseEstimator::State {
  Thinned<std::vector<Triple>> by_scan{400};  // so many scans tell enough
  double resolution_m = coarsest_m;
};

ScanNoiseEstimator::ScanNoiseEstimator() : state_(std::make_unique<State>()) {}
ScanNoiseEstimator::~ScanNoiseEstimator() = default;

void ScanNoiseEstimator::add(const Scan& scan) {
  state_->resolution_m = resolution_m(scan, state_->resolution_m);
  if (state_->by_scan.next()) state_->by_scan.keep(triples_of(scan));
}

ScanNoise ScanNoiseEstimator::estimate() const {
  std::vector<Triple> triples;
  for (const std::vector<Triple>& of_scan : state_->by_scan.kept())
    triples.insert(triples.end(), of_scan.begin(), of_scan.end());
  if (triples.size() < 30)
    throw InputError("the scans hold too few neighbouring returns to estimate the noise from; state it");
  std::sort(triples.begin(), triples.end(),
            [](const Triple& a, const Triple& b) { return a.range_m < b.range_m; });
  const std::size_t bins = std::clamp<std::size_t>(triples.size() / 50, 1, 12);
  std::vector<SpreadSample> samples;
  for (std::size_t bin = 0; bin < bins; ++bin) {
    const std::size_t from = bin * triples.size() / bins, to = (bin + 1) * triples.size() / bins;
    std::vector<double> sizes, ranges;
    for (std::size_t i = from; i < to; ++i) {
      sizes.push_back(std::abs(triples[i].error_m));
      ranges.push_back(triples[i].range_m);
    }
    const double sigma = kMadToSigma * upper_median(std::move(sizes));
    samples.push_back({upper_median(std::move(ranges)), sigma * sigma, static_cast<double>(to - from)});
  }
  const double resolution = state_->resolution_m < coarsest_m ? state_->resolution_m : 0.0;
  return fit_scan_noise(samples, std::max(1e-4, 0.5 * resolution));
}

}  // namespace rangecal
