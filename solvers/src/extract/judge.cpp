// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "rangecal/core/distributions.hpp"
#include "rangecal/solvers/extract/segments.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

constexpr double kWall = 0.3;           ///< shortest wall [m]
constexpr double kStraightShare = 0.7;  ///< of a wall's beams that lie on straight pieces
constexpr int kPiece = 5;               ///< beams of a straight piece

double chi_squared_tail(double chi_squared, int degrees) {
  return degrees > 0 ? chi_squared_upper(chi_squared, degrees) : 1.0;
}

double middle_range_m(std::span<const Beam> beams) {
  std::vector<double> ranges;
  for (const Beam& beam : beams) ranges.push_back(beam.range_m);
  return upper_median(std::move(ranges));
}

Eigen::Vector2d point(const Beam& beam) {
  return {beam.range_m * std::cos(beam.bearing_rad), beam.range_m * std::sin(beam.bearing_rad)};
}

/// Beams on straight pieces: split where a piece is farthest from its chord, until its line fits.
int straight_beams(std::span<const Beam> beams, const ScanNoise& noise) {
  const int count = static_cast<int>(beams.size());
  if (count < kPiece) return 0;
  const Eigen::Vector2d from = point(beams.front()), along = (point(beams.back()) - from).normalized();
  std::size_t farthest = 0;
  double most = 0.0, sigmas = 0.0;
  for (std::size_t i = 1; i + 1 < beams.size(); ++i) {
    const Eigen::Vector2d v = point(beams[i]) - from;
    const double off = std::abs(v.x() * along.y() - v.y() * along.x());
    sigmas = std::max(sigmas, off / std::hypot(noise.spread(beams[i].range_m), 0.01));
    if (off > most) most = off, farthest = i;
  }
  if (sigmas < 4.0 || farthest == 0) return count;
  return straight_beams(beams.first(farthest + 1), noise) + straight_beams(beams.subspan(farthest), noise);
}

SegmentVerdict not_a_cylinder(const Segment& segment, const ScanNoise& noise, const char* reason) {
  SegmentVerdict finding;
  finding.reason = reason;
  double length = 0.0;
  for (std::size_t i = 1; i < segment.beams.size(); ++i)
    length = std::max(length, (point(segment.beams[i]) - point(segment.beams.front())).norm());
  if (length < kWall) return finding;
  const int straight = straight_beams(segment.beams, noise);
  if (straight >= kStraightShare * static_cast<double>(segment.beams.size())) {
    finding.kind = FindingKind::wall;
    finding.reason = "wall";
  }
  return finding;
}

/// The outline; where an end is hidden it says no more than that the axis is behind the hits.
Outline outline(const Segment& segment) {
  Outline out = outline_of(segment.miss_left_rad, segment.beams.front().bearing_rad,
                           segment.beams.back().bearing_rad, segment.miss_right_rad);
  if (segment.nearer_left || segment.nearer_right) out.centre_sd_rad = out.half_width_rad;
  return out;
}

double gaps_rad(const Segment& segment) {
  return (segment.beams.front().bearing_rad - segment.miss_left_rad) +
         (segment.miss_right_rad - segment.beams.back().bearing_rad);
}

double expected_half_width_rad(const CircleFit& fit) {
  return std::asin(std::min(1.0, fit.radius_m / (fit.range_m + fit.radius_m)));
}

/// How far the circle is from the segment: chi-squared beyond its mean, and the width in the edges' uncertainty.
double misfit(const Segment& segment, const CircleFit& fit) {
  const double sd = std::hypot(gaps_rad(segment) / std::sqrt(48.0), 0.03 * expected_half_width_rad(fit));
  const double off = (outline(segment).half_width_rad - expected_half_width_rad(fit)) / sd;
  return fit.chi_squared - fit.degrees_of_freedom + off * off;
}

/// 1 where the segment is wider than the circle can look from where it may be, -1 narrower, 0 alike: to the edges'
/// gaps, the slack of the raw range, 8 % if wider, and 18 % if narrower, because grazing beams get lost.
int compare_width(const Segment& segment, const CircleFit& fit, const CylinderOptions& options) {
  const double seen = outline(segment).half_width_rad, axis = fit.range_m + fit.radius_m;
  const double slack = options.range_slack_m + options.range_slack * fit.range_m,
               gaps = 0.4 * gaps_rad(segment);
  const double widest = 1.08 * std::asin(fit.radius_m / std::max(1.05 * fit.radius_m, axis - slack));
  const double narrowest = 0.82 * std::asin(fit.radius_m / (axis + slack));
  if (seen > widest + gaps) return 1;
  const bool hidden = segment.nearer_left || segment.nearer_right;
  return seen < (hidden ? 0.6 * narrowest : narrowest - gaps) ? -1 : 0;
}

std::optional<CircleFit> fit_once(const Segment& segment, double sigma, const CylinderOptions& options,
                                  std::optional<double> radius) {
  CircleFitOptions fitting;
  fitting.radius_m = radius;
  fitting.sigma_m = sigma;
  fitting.edge_cut = options.edge_cut;
  fitting.radius_min_m = options.radius_min_m, fitting.radius_max_m = options.radius_max_m;
  return fit_circle(segment.beams, outline(segment), fitting);
}

/// Drops an outermost hit that lies more than 4 sigma behind the arc: lit partly by the cylinder, partly by what is
/// behind it. Returns how many were dropped (at most one at each end).
int drop_mixed(Segment& segment, const CircleFit& fit, double sigma) {
  int dropped = 0;
  const auto behind = [&](const Beam& beam) {
    const auto arc =
        range_on_circle(fit.range_m + fit.radius_m, fit.radius_m, beam.bearing_rad - fit.bearing_rad);
    return beam.range_m > arc.value_or(fit.range_m + fit.radius_m) + 4.0 * sigma;
  };
  if (segment.beams.size() > 3 && behind(segment.beams.back())) {
    segment.miss_right_rad = segment.beams.back().bearing_rad;
    segment.beams.pop_back(), ++dropped;
  }
  if (segment.beams.size() > 3 && behind(segment.beams.front())) {
    segment.miss_left_rad = segment.beams.front().bearing_rad;
    segment.beams.erase(segment.beams.begin()), ++dropped;
  }
  return dropped;
}

double tolerant_sigma(double sigma, double radius, const CylinderOptions& options) {
  return std::hypot(sigma, options.shape_tolerance * radius);
}

/// Fit, mixed pixels dropped, fit again.
std::optional<CircleFit> fit_cleaned(Segment segment, double sigma, const CylinderOptions& options,
                                     std::optional<double> radius, int& mixed, Segment* cleaned) {
  auto fit = fit_once(segment, sigma, options, radius);
  mixed = fit ? drop_mixed(segment, *fit, tolerant_sigma(sigma, fit->radius_m, options)) : 0;
  if (mixed > 0) fit = fit_once(segment, sigma, options, radius);
  if (cleaned) *cleaned = std::move(segment);
  return fit;
}

SegmentVerdict judge_with_radius(const Segment& segment, const ScanNoise& noise,
                                 const CylinderOptions& options, std::optional<double> radius) {
  const double sigma = noise.spread(middle_range_m(segment.beams));
  SegmentVerdict finding;
  Segment cleaned;
  const auto fit = fit_cleaned(segment, sigma, options, radius, finding.mixed_pixels, &cleaned);
  if (!fit)
    return not_a_cylinder(segment, noise, radius ? "no circle fits" : "no circle of the radii allowed fits");
  const int width = compare_width(cleaned, *fit, options);
  if (width > 0) return not_a_cylinder(segment, noise, "too wide");
  if (width < 0) return not_a_cylinder(segment, noise, "too narrow");
  const double tolerant = tolerant_sigma(sigma, fit->radius_m, options);
  const double relaxed = fit->chi_squared * (sigma * sigma) / (tolerant * tolerant);
  if (chi_squared_tail(relaxed, fit->degrees_of_freedom) < options.fit_p_value)
    return not_a_cylinder(segment, noise, "no circle fits");
  std::vector<Beam> inner;
  for (const Beam& beam : cleaned.beams)
    if (std::abs(std::sin(beam.bearing_rad - fit->bearing_rad)) * (fit->range_m + fit->radius_m) <=
        options.edge_cut * fit->radius_m)
      inner.push_back(beam);
  const FlatFit flat = fit_flat(inner, tolerant);
  const double advantage =
      0.5 * ((relaxed - fit->degrees_of_freedom) - (flat.chi_squared - flat.degrees_of_freedom));
  // A radius that is estimated takes its evidence from the curvature: there the line must lose.
  if (advantage > (radius ? options.flat_nats : -options.flat_nats))
    return not_a_cylinder(segment, noise, "flat");
  if (!radius && fit->radius_sd_m > 0.3 * fit->radius_m)
    return not_a_cylinder(segment, noise, "too few beams for a radius");
  finding.kind = FindingKind::cylinder;
  finding.flat_nats = advantage;
  finding.fit = *fit;
  return finding;
}

}  // namespace

SegmentVerdict judge_segment(const Segment& segment, const ScanNoise& noise, const CylinderOptions& options) {
  if (static_cast<int>(segment.beams.size()) < options.beams_min)
    return not_a_cylinder(segment, noise, "too few beams");
  if (segment.view_ends) return not_a_cylinder(segment, noise, "cut by the field of view");
  if (segment.nearer_left && segment.nearer_right)
    return not_a_cylinder(segment, noise, "seen through a gap");
  if (options.radii_m.empty()) return judge_with_radius(segment, noise, options, std::nullopt);
  SegmentVerdict best;
  double least = std::numeric_limits<double>::infinity();
  for (const double radius : options.radii_m) {
    const SegmentVerdict finding = judge_with_radius(segment, noise, options, radius);
    const bool cylinder = finding.kind == FindingKind::cylinder;
    const double off = cylinder ? misfit(segment, finding.fit) : std::numeric_limits<double>::infinity();
    if (radius == options.radii_m.front() || off < least) best = finding;
    least = std::min(least, off);
  }
  return best;
}

double radius_misfit(const Segment& segment, const ScanNoise& noise, const CylinderOptions& options,
                     double radius_m) {
  const auto fit = refit_segment(segment, noise, options, radius_m);
  return fit ? misfit(segment, *fit) : std::numeric_limits<double>::infinity();
}

std::optional<CircleFit> refit_segment(const Segment& segment, const ScanNoise& noise,
                                       const CylinderOptions& options, double radius_m, Segment* cleaned) {
  int mixed = 0;
  return fit_cleaned(segment, noise.spread(middle_range_m(segment.beams)), options, radius_m, mixed, cleaned);
}

}  // namespace rangecal
