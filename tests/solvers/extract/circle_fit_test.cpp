// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/circle_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

/// A cylinder on a grid of beams with a random phase.
struct Shot {
  std::vector<Beam> beams;
  Outline outline;
};

Shot shoot(double range, double bearing, double radius, double step, double sigma, Random& random) {
  Shot shot;
  const double phase = random.uniform() * step, axis = range + radius;
  const double half = std::asin(radius / axis);
  const auto first = static_cast<long>(std::ceil((bearing - half - phase) / step));
  for (long i = first;; ++i) {
    const double angle = static_cast<double>(i) * step + phase;
    const auto hit = range_on_circle(axis, radius, angle - bearing);
    if (!hit) break;
    shot.beams.push_back({angle, *hit + sigma * random.normal()});
  }
  shot.outline = outline_of(shot.beams.front().bearing_rad - step, shot.beams.front().bearing_rad,
                            shot.beams.back().bearing_rad, shot.beams.back().bearing_rad + step);
  return shot;
}

TEST(CircleFit, HandWorkedReadings) {
  // Axis at 2 m, R = 0.5 m: straight on 2 - 0.5 = 1.5; at asin(0.15) the beam passes the axis at 0.3 m, so the range is
  // 2 cos - sqrt(0.25 - 0.09) = 2 sqrt(1 - 0.0225) - 0.4 = 1.577371993...
  EXPECT_DOUBLE_EQ(*range_on_circle(2.0, 0.5, 0.0), 1.5);
  EXPECT_NEAR(*range_on_circle(2.0, 0.5, std::asin(0.15)), 1.5773719933, 1e-9);
  EXPECT_FALSE(range_on_circle(2.0, 0.5, std::asin(0.25) + 1e-9));
  // Edges between 0.0 and 0.1, and between 0.5 and 0.6: middle (0.05 + 0.55) / 2, variance 2 x 0.01 / 48.
  const Outline outline = outline_of(0.0, 0.1, 0.5, 0.6);
  EXPECT_NEAR(outline.centre_rad, 0.3, 1e-15);
  EXPECT_NEAR(outline.half_width_rad, 0.25, 1e-15);
  EXPECT_NEAR(outline.centre_sd_rad, std::sqrt(0.02 / 48.0), 1e-15);
}

TEST(CircleFit, ExactWithoutNoise) {
  Random random(seed_from("CircleFit.ExactWithoutNoise"));
  for (int i = 0; i < 20; ++i) {
    const double range = random.uniform(0.3, 3.0), radius = random.uniform(0.05, 0.15);
    const double bearing = random.uniform(-3.0, 3.0);
    Shot shot = shoot(range, bearing, radius, 0.004, 0.0, random);
    shot.outline.centre_rad = bearing;  // the outline is exact only to half a step
    const auto known = fit_circle(shot.beams, shot.outline, {.radius_m = radius, .sigma_m = 1e-3});
    ASSERT_TRUE(known) << range << " " << radius;
    EXPECT_NEAR(known->range_m, range, 1e-9);
    EXPECT_NEAR(known->bearing_rad, bearing, 1e-9);
    const auto free = fit_circle(shot.beams, shot.outline, {.sigma_m = 1e-3});
    ASSERT_TRUE(free) << range << " " << radius;
    EXPECT_NEAR(free->radius_m, radius, 1e-7);
    EXPECT_NEAR(free->range_m, range, 1e-7);
  }
}

/// Mean of squared errors over stated variances, for range, bearing and radius.
struct ChiSquared {
  double range = 0.0, bearing = 0.0, radius = 0.0;
  int count = 0;
};

ChiSquared sample(bool free, const char* name) {
  ChiSquared out;
  for (int i = 0; i < 4000; ++i) {
    Random random(seed_from(name, {static_cast<std::uint64_t>(i)}));
    const double range = random.uniform(0.4, free ? 1.2 : 3.0), radius = 0.12,
                 sigma = 0.001 + 0.002 * range * range;
    const double bearing = random.uniform(-1.0, 1.0);
    const Shot shot = shoot(range, bearing, radius, 0.0087, sigma, random);
    CircleFitOptions options;
    options.sigma_m = sigma;
    if (!free) options.radius_m = radius;
    const auto fit = fit_circle(shot.beams, shot.outline, options);
    if (!fit) continue;
    ++out.count;
    out.range += std::pow((fit->range_m - range) / fit->range_sd_m, 2);
    out.bearing += std::pow((fit->bearing_rad - bearing) / fit->bearing_sd_rad, 2);
    if (free) out.radius += std::pow((fit->radius_m - radius) / fit->radius_sd_m, 2);
  }
  out.range /= out.count, out.bearing /= out.count, out.radius /= out.count;
  return out;
}

// The mean of 4000 squared standard normals has standard deviation sqrt(2 / 4000) = 0.022. Bearings draw from the
// uniform edges too, and the edges of one cylinder are not independent: 0.1 is allowed.
TEST(CircleFit, ErrorsMatchTheStatedStandardDeviations) {
  const ChiSquared result = sample(false, "CircleFit.Known");
  EXPECT_GE(result.count, 3990);
  EXPECT_NEAR(result.range, 1.0, 0.1);
  EXPECT_NEAR(result.bearing, 1.0, 0.15);
}

TEST(CircleFit, SoTheyDoWithTheRadiusEstimated) {
  const ChiSquared result = sample(true, "CircleFit.Free");
  EXPECT_GE(result.count, 3950);
  EXPECT_NEAR(result.range, 1.0, 0.12);
  EXPECT_NEAR(result.radius, 1.0, 0.15);
  EXPECT_NEAR(result.bearing, 1.0, 0.15);
}

TEST(CircleFit, SaysNoToTooFewBeamsAndToAWall) {
  const Outline outline = outline_of(-0.01, 0.0, 0.01, 0.02);
  EXPECT_FALSE(fit_circle({}, outline, {.radius_m = 0.1}));
  const std::vector<Beam> one{{0.0, 1.0}};
  EXPECT_FALSE(fit_circle(one, outline, {.radius_m = 0.1}));
  std::vector<Beam> wall;
  for (int i = -20; i <= 20; ++i) wall.push_back({0.01 * i, 1.0 / std::cos(0.01 * i)});
  EXPECT_FALSE(fit_circle(wall, outline_of(-0.21, -0.2, 0.2, 0.21), {.sigma_m = 1e-3}));
  EXPECT_NEAR(fit_flat(wall, 1e-3).chi_squared, 0.0, 1e-9);
}

}  // namespace
}  // namespace rangecal
