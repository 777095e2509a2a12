// SPDX-License-Identifier: BSD-3-Clause
#include "extract/common_radius.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "extract/arc_slope.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::extract {
namespace {

constexpr double kArcStep = 0.00872664626;  ///< half a degree

/// A cylinder in one scan; `phase` of the beams' grid, as a share of its step.
Arc seen_arc(double axis, double bearing, double radius, double phase, double sigma, Random& random) {
  Arc arc;
  const auto first = static_cast<long>(std::ceil((bearing - std::asin(radius / axis)) / kArcStep - phase));
  for (long i = first;; ++i) {
    const double angle = (static_cast<double>(i) + phase) * kArcStep;
    const auto hit = range_on_circle(axis, radius, angle - bearing);
    if (!hit) break;
    arc.beams.push_back({angle, *hit + sigma * random.normal()});
  }
  arc.outline = outline_of(arc.beams.front().bearing_rad - kArcStep, arc.beams.front().bearing_rad,
                           arc.beams.back().bearing_rad, arc.beams.back().bearing_rad + kArcStep);
  arc.range_m = axis - radius, arc.sigma_m = sigma;
  return arc;
}

/// Six stops 0.9 to 2.2 m from the axis; the scans of a stop share the grid.
std::vector<std::vector<Arc>> seen_from_stops(double radius, double sigma, int scans, Random& random) {
  std::vector<std::vector<Arc>> stops(6);
  for (std::vector<Arc>& arcs : stops) {
    const double axis = random.uniform(0.9, 2.2), bearing = random.uniform(-3.0, 3.0),
                 phase = random.uniform();
    for (int i = 0; i < scans; ++i) arcs.push_back(seen_arc(axis, bearing, radius, phase, sigma, random));
  }
  return stops;
}

TEST(CommonRadius, SlopesOfTheArcAreThoseOfDifferences) {
  // Axis at 2 m, R = 0.5 m, a beam that passes the axis at 0.3 m: CircleFit.HandWorkedReadings.
  EXPECT_NEAR(arc_point(1.5, 0.0, 0.5, std::asin(0.15)).range_m, 1.5773719933, 1e-9);
  const double s = 1.2, b = 0.3, R = 0.1, bearing = 0.34, h = 1e-6;
  const Eigen::Vector3d slope = arc_point(s, b, R, bearing).slope;
  const auto difference = [&](double ds, double db, double dR) {
    return (arc_point(s + ds, b + db, R + dR, bearing).range_m -
            arc_point(s - ds, b - db, R - dR, bearing).range_m) /
           (2.0 * h);
  };
  // central differences: h^2 times the third derivative, and rounding 1e-16 / h
  EXPECT_NEAR(slope(0), difference(h, 0.0, 0.0), 1e-7);
  EXPECT_NEAR(slope(1), difference(0.0, h, 0.0), 1e-6);
  EXPECT_NEAR(slope(2), difference(0.0, 0.0, h), 1e-7);
}

TEST(CommonRadius, ExactWithoutNoise) {
  Random random(seed_from("CommonRadius.ExactWithoutNoise"));
  for (const double radius : {0.04, 0.06, 0.1, 0.15}) {
    const double sigma = 1e-9;  // the ranges are exact to it
    const auto stops = seen_from_stops(radius, sigma, 3, random);
    for (const double start : {0.9 * radius, radius, 1.15 * radius}) {
      const auto found = common_radius(stops, start, {});
      ASSERT_TRUE(found) << radius << " " << start;
      EXPECT_NEAR(found->radius_m, radius, 1e-8);
    }
  }
}

// 150 landmarks each: errors over their standard deviations have a mean of 0 +- 1 / sqrt(150) = 0.082, four of which and 0.2
// are allowed, for the terms of higher order and the grid that the scans of a stop share; their mean square is 1 +-
// sqrt(2 / 150) = 0.115. Means of the arcs' own radii, weighted by their variances, are 5 and 10 standard deviations low.
TEST(CommonRadius, HasNoBiasAndStatesItsStandardDeviation) {
  struct Kind {
    double radius_m, sigma_m;
  };
  std::uint64_t number = 0;
  for (const Kind& kind : {Kind{0.1, 0.004}, Kind{0.06, 0.004}, Kind{0.06, 0.002}}) {
    SCOPED_TRACE(kind.radius_m);
    double sum = 0.0, squares = 0.0;
    constexpr int landmarks = 150;
    for (std::uint64_t i = 0; i < landmarks; ++i) {
      Random random(seed_from("CommonRadius.Bias", {number, i}));
      const auto found =
          common_radius(seen_from_stops(kind.radius_m, kind.sigma_m, 6, random), 0.95 * kind.radius_m, {});
      ASSERT_TRUE(found) << i;
      const double z = (found->radius_m - kind.radius_m) / found->sd_m;
      sum += z, squares += z * z;
    }
    EXPECT_LT(std::abs(sum / landmarks), 0.2 + 4.0 * 0.082);
    EXPECT_GT(squares / landmarks, 1.0 - 4.0 * 0.115);
    EXPECT_LT(squares / landmarks, 1.2 + 4.0 * 0.115);
    ++number;
  }
}

// Scans of a stop that each begin anywhere, and one whose bearings run on beyond a turn, say the same of R.
TEST(CommonRadius, KnowsAnglesBeyondATurn) {
  Random random(seed_from("CommonRadius.Turn"));
  auto stops = seen_from_stops(0.1, 0.001, 4, random);
  const auto before = common_radius(stops, 0.1, {});
  for (Beam& beam : stops[2][1].beams) beam.bearing_rad += 2.0 * M_PI;
  stops[2][1].outline.centre_rad += 2.0 * M_PI;
  const auto after = common_radius(stops, 0.1, {});
  ASSERT_TRUE(before && after);
  EXPECT_NEAR(after->radius_m, before->radius_m, 1e-9);
}

TEST(CommonRadius, SaysNoToAFaceAndToTooFewHits) {
  Random random(seed_from("CommonRadius.No"));
  EXPECT_FALSE(common_radius({}, 0.1, {}));
  std::vector<std::vector<Arc>> flat(1);
  for (int scan = 0; scan < 5; ++scan) {  // 20 cm wide, 1.5 m away: no circle of at most 20 cm
    Arc arc = seen_arc(1.6, 0.0, 0.1, 0.5, 0.001, random);
    for (Beam& beam : arc.beams) beam.range_m = 1.5 / std::cos(beam.bearing_rad) + 0.001 * random.normal();
    flat[0].push_back(arc);
  }
  EXPECT_FALSE(common_radius(flat, 0.1, {}));
  std::vector<std::vector<Arc>> few(1, {seen_arc(1.6, 0.0, 0.1, 0.5, 0.001, random)});
  few[0][0].beams.resize(2);
  EXPECT_FALSE(common_radius(few, 0.1, {}));
}

}  // namespace
}  // namespace rangecal::extract
