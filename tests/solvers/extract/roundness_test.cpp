// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/roundness.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <vector>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

constexpr double kRadius = 0.1, kNearest = 1.9, kStep = 0.004;

/// Beams on a face x = depth(y), seen from the origin; y to three decimals of the radius by bisection on the bearing.
std::vector<Beam> seen(const std::function<double(double)>& depth, Random* random, double sigma) {
  std::vector<Beam> beams;
  for (int i = -11; i <= 11; ++i) {
    const double bearing = kStep * i;
    double y = kNearest * std::tan(bearing);
    for (int round = 0; round < 40; ++round) y = depth(y) * std::tan(bearing);
    beams.push_back({bearing, std::hypot(depth(y), y) + (random ? sigma * random->normal() : 0.0)});
  }
  return beams;
}

Roundness of(const std::function<double(double)>& depth, int sightings = 1, Random* random = nullptr,
             double sigma = 0.01) {
  CircleFit fit;
  fit.range_m = kNearest, fit.radius_m = kRadius;
  Roundness roundness;
  for (int k = 0; k < sightings; ++k) roundness.add(seen(depth, random, sigma), fit, sigma, 0.9);
  return roundness;
}

double circle(double y) { return kNearest + kRadius - std::sqrt(std::max(0.0, kRadius * kRadius - y * y)); }

TEST(Roundness, KnowsCirclesFacesAndCorners) {
  // The circle is its own model: bow 1, lean 0, but for the prior on the lean, which is 0 too.
  const Roundness::Shape round = of(circle).shape();
  EXPECT_NEAR(round.bow, 1.0, 1e-9);
  EXPECT_NEAR(round.lean, 0.0, 1e-9);
  EXPECT_EQ(of(circle).most_hits(),
            23);  // |y| <= 0.9 R = 90 mm; the outermost beam passes at 2 sin(0.044) = 88 mm

  const Roundness::Shape flat = of([](double y) { return kNearest + 0.3 * y; }).shape();
  EXPECT_NEAR(flat.bow, 0.0, 1e-9);
  EXPECT_NEAR(flat.lean, 0.0, 1e-9);

  // A right-angled corner, x = |y|, over |y| <= 0.88 R: cov(|y|, h) / var(h) with h = R - sqrt(R^2 - y^2). For even y up
  // to 0.9 R: (0.1103 - 0.45 * 0.160) / (0.0500 - 0.160^2) = 1.57.
  EXPECT_NEAR(of([](double y) { return kNearest + std::abs(y); }).shape().bow, 1.57, 0.1);

  // A face that bends to one side: its cube is the lean, less what the prior takes (4 against some 1e2).
  const Roundness::Shape lopsided =
      of([](double y) { return circle(y) + 0.8 * kRadius * std::pow(y / kRadius, 3); }, 20).shape();
  EXPECT_NEAR(lopsided.bow, 1.0, 0.05);
  EXPECT_NEAR(lopsided.lean, 0.8, 0.05);
}

TEST(Roundness, StatesItsUncertainty) {
  // 400 landmarks of three sightings: the mean of squared standard normals is 1 +- sqrt(2 / 400) = 0.07.
  Random random(seed_from("Roundness.Uncertainty"));
  double bow = 0.0;
  constexpr int landmarks = 400;
  for (int k = 0; k < landmarks; ++k) {
    const Roundness::Shape shape = of(circle, 3, &random).shape();
    bow += std::pow((shape.bow - 1.0) / shape.bow_sd, 2) / landmarks;
  }
  EXPECT_NEAR(bow, 1.0, 0.25);
}

TEST(Roundness, SaysNothingOfTwoHits) {
  CircleFit fit;
  fit.range_m = kNearest, fit.radius_m = kRadius;
  Roundness roundness;
  roundness.add(std::vector<Beam>{{-0.01, 1.9}, {0.01, 1.9}}, fit, 0.01, 0.9);
  EXPECT_EQ(roundness.most_hits(), 2);
  EXPECT_TRUE(std::isinf(roundness.shape().bow_sd));
}

}  // namespace
}  // namespace rangecal
