// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/effect_correction.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <functional>
#include <numbers>
#include <string>
#include <vector>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

/// f(d) = d between 0.3 and 5 m, a spread of 1 mm everywhere, and one effect.
Calibration straight(const std::string& effect, const std::map<std::string, double>& parameters) {
  Calibration c;
  c.kind = RecordingKind::pairs;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector3d(0.0, 1.0, 0.0);
  c.noise.law = NoiseLaw::constant;
  c.noise.parameters = Eigen::VectorXd::Constant(1, 0.001);
  c.range_min_m = 0.3;
  c.range_max_m = 5.0;
  c.effects[effect] = parameters;
  return c;
}

std::vector<double> distances(const std::vector<CorrectionRoot>& roots) {
  std::vector<double> d;
  for (const CorrectionRoot& root : roots) d.push_back(root.distance_m);
  return d;
}

/// Where g passes y, on a grid of 20 um.
std::vector<double> passes(const std::function<double(double)>& g, double y) {
  constexpr double step = 2e-5;
  std::vector<double> at;
  for (double d = 0.01; d < 5.46; d += step)
    if ((g(d) - y < 0.0) != (g(d + step) - y < 0.0)) at.push_back(d + 0.5 * step);
  return at;
}

TEST(EffectCorrector, AJumpGivesTwoDistancesOrNone) {
  // 30 mm more below 1 m: 1.005 m is read at 0.975 m and at 1.005 m. 30 mm less: nothing is read as 0.98 m.
  const Calibration more = straight("near_regime", {{"offset_m", 0.03}, {"slope", 0.0}, {"limit_m", 1.0}});
  const Correction both = EffectCorrector(more, {}).correct(1.005, {});
  ASSERT_EQ(both.least_squares.size(), 2u);
  EXPECT_NEAR(both.least_squares[0].distance_m, 0.975, 1e-9);
  EXPECT_NEAR(both.least_squares[1].distance_m, 1.005, 1e-9);
  const Calibration less = straight("near_regime", {{"offset_m", -0.03}, {"slope", 0.0}, {"limit_m", 1.0}});
  const Correction none = EffectCorrector(less, {}).correct(0.98, {});
  EXPECT_TRUE(none.least_squares.empty());
  ASSERT_TRUE(none.nearest);
  EXPECT_NEAR(none.nearest->distance_m, 1.0, 1e-6);  // read as 0.97 m on the one side, as 1 m on the other
}

TEST(EffectCorrector, FindsEveryDistanceWhereTheEffectFoldsTheCurve) {
  // The cyclic error folds f where amplitude times wavenumber > 1.
  const double k = 140.0;
  Random random(seed_from("EffectCorrector.Folds"));
  std::size_t most = 0;
  for (const double amplitude : {0.005, 0.02, 0.05}) {
    const Calibration c =
        straight("cyclic_error", {{"cosine_m", 0.0}, {"sine_m", amplitude}, {"wavenumber_per_m", k}});
    const EffectCorrector corrector(c, {});
    const auto g = [&](double d) { return d + amplitude * std::sin(k * d); };
    for (int i = 0; i < 40; ++i) {
      const double y = random.uniform(0.6, 4.5);
      const std::vector<double> found = distances(corrector.correct(y, {}).least_squares);
      const std::vector<double> there = passes(g, y);
      ASSERT_EQ(found.size(), there.size()) << amplitude << " m, " << y << " m";
      for (std::size_t r = 0; r < found.size(); ++r) {
        EXPECT_NEAR(found[r], there[r], 1e-4);
        EXPECT_NEAR(g(found[r]), y, 1e-11);
      }
      most = std::max(most, found.size());
    }
  }
  EXPECT_GE(most, 3u);
}

TEST(EffectCorrector, APullToPixelCentresFoldsNothing) {
  // The centroid of a spot rises with its place, so that the reading does with the distance.
  for (const double a : {0.1, 0.2, 0.25}) {
    const Calibration c = straight(
        "pixel_locking",
        {{"cosine_per_m", 0.0}, {"sine_per_m", a / 120.0}, {"wavenumber_m", 2.0 * std::numbers::pi * 120.0}});
    const EffectCorrector corrector(c, {});
    Random random(seed_from("EffectCorrector.Pull"));
    for (int i = 0; i < 40; ++i)
      EXPECT_EQ(corrector.correct(random.uniform(0.6, 4.5), {}).least_squares.size(), 1u) << a << " px";
  }
}

TEST(EffectCorrector, APullOfTheSpotIsOfTheWayThatACoverLeaves) {
  // The cover adds 3 mm: 0.6 m stands for 0.603 m there, 200 pixels' periods, where the pull is at its crest.
  const double k = 200.0 * 2.0 * std::numbers::pi * 0.603;
  Calibration c =
      straight("pixel_locking", {{"cosine_per_m", 1e-4}, {"sine_per_m", 0.0}, {"wavenumber_m", k}});
  c.effects["range_eccentricity"] = {{"cosine_m", 0.003}, {"sine_m", 0.0}};
  ReadingSetting ahead;
  ahead.bearing_rad = 0.0;
  const EffectCorrector corrector(c, {});
  const double y = 0.603 + 1e-4 * 0.603 * 0.603;
  EXPECT_NEAR(corrector.at(0.6, ahead).mean_m, y, 1e-10);
  const Correction corrected = corrector.correct(y, ahead);
  ASSERT_EQ(corrected.least_squares.size(), 1u);
  EXPECT_NEAR(corrected.least_squares[0].distance_m, 0.6, 1e-8);
}

TEST(EffectCorrector, StandardDeviationsFollowTheSlopeOfTheEffectToo) {
  // A scale of -0.6 leaves f' = 0.4: 1 mm of the reading is 2.5 mm of distance, and f(2.5 m) = 1 m.
  const Calibration scaled = straight("range_scale", {{"scale", -0.6}, {"form", 0.0}});
  const Correction c = EffectCorrector(scaled, {}).correct(1.0, {});
  ASSERT_EQ(c.least_squares.size(), 1u);
  EXPECT_NEAR(c.least_squares[0].distance_m, 2.5, 1e-9);
  EXPECT_NEAR(*c.least_squares[0].std_dev_m, 0.0025, 1e-9);
}

TEST(EffectCorrector, StandardDeviationsCountHowWellTheEffectIsKnown) {
  // g(d) = d + theta d, theta = -0.6: h = (1, d, 0, d), g' = 0.4. At y = 1, d = 2.5: with var(alpha_0) = 1e-6,
  // var(alpha_1) = 4e-6, var(theta) = 9e-6 and cov(alpha_1, theta) = -5e-6, var g = 1e-6 + 6.25 (4 + 9 - 2 * 5) 1e-6.
  Calibration scaled = straight("range_scale", {{"scale", -0.6}, {"form", 0.0}});
  scaled.alpha_covariance = Eigen::Vector3d(1e-6, 1e-6, 0.0).asDiagonal();
  EXPECT_TRUE(EffectCorrector(scaled, {}).takes_effects_as_exact());
  const auto total = [&] {
    return *EffectCorrector(scaled, {}).correct(1.0, {}).least_squares.at(0).std_dev_total_m;
  };
  EXPECT_NEAR(total(), std::sqrt(1e-6 + 1e-6 + 6.25e-6) / 0.4, 1e-9);
  EffectsCovariance known{{"range_scale.scale"}, Eigen::MatrixXd::Zero(4, 4)};
  known.matrix.diagonal() << 1e-6, 4e-6, 0.0, 9e-6;
  known.matrix(1, 3) = known.matrix(3, 1) = -5e-6;
  scaled.effects_covariance = known;
  EXPECT_FALSE(EffectCorrector(scaled, {}).takes_effects_as_exact());
  const double variance = 1e-6 + 6.25 * 3e-6;
  EXPECT_NEAR(total(), std::sqrt(1e-6 + variance) / 0.4, 1e-9);
  EXPECT_NEAR(EffectCorrector(scaled, {}).at(2.5, {}).spread_m, std::sqrt(1e-6 + variance), 1e-9);
}

TEST(EffectCorrector, ParametersThatDependOnEachOtherCancelHoweverPoorlyTheyAreKnown) {
  // A drift known in its first 900 s but for T: o / T = 4.8e-6 m/s stands, T = 10 000 +- 100 000 s. The tangent leaves
  // 10 o (1 - e^-x - x e^-x), x = 0.09, of the two deviations.
  Calibration drift =
      straight("warmup_drift", {{"offset_m", 0.048}, {"curvature_per_m", 0.0}, {"time_s", 1e4}});
  EffectsCovariance known{{"warmup_drift.offset_m", "warmup_drift.time_s"}, Eigen::MatrixXd::Zero(5, 5)};
  known.matrix.bottomRightCorner(2, 2) << 0.48 * 0.48, 0.48 * 1e5, 0.48 * 1e5, 1e10;
  drift.effects_covariance = known;
  ReadingSetting late;
  late.time_s = 900.0;
  const double x = 0.09, left = 0.48 * (1.0 - std::exp(-x) - x * std::exp(-x));
  const CorrectionRoot root = EffectCorrector(drift, {}).correct(2.0, late).least_squares.at(0);
  EXPECT_NEAR(*root.std_dev_total_m, std::hypot(0.001, left), 1e-6);
}

TEST(EffectCorrector, WhatComesBeforeTheCurveMovesWithTheCurve) {
  // Depth along the axis: at 60 degrees g(d) = f(d / 2), so a reading of 1 m is d = 2, g' = 1 / 2, and alpha_1 moves it by
  // d / 2 = 1 per unit.
  Calibration depth = straight("axial_depth", {{"kappa", 1.0}, {"axis_rad", 0.0}});
  EffectsCovariance known{{"axial_depth.kappa"}, Eigen::MatrixXd::Zero(4, 4)};
  known.matrix(1, 1) = 1e-6;
  depth.effects_covariance = known;
  ReadingSetting aside;
  aside.bearing_rad = std::numbers::pi / 3.0;
  const CorrectionRoot root = EffectCorrector(depth, {}).correct(1.0, aside).least_squares.at(0);
  EXPECT_NEAR(root.distance_m, 2.0, 1e-9);
  EXPECT_NEAR(*root.std_dev_total_m, std::sqrt(1e-6 + 1e-6) / 0.5, 1e-7);
}

TEST(EffectCorrector, EffectsThatMoveNoMeanAreNotTakenAsExact) {
  const Calibration spread = straight("cell_effect", {{"sigma_m", 0.01}});
  EXPECT_FALSE(EffectCorrector(spread, {}).takes_effects_as_exact());
}

TEST(EffectCorrector, StandardDeviationPredictsTheScatterOfCalibrationsWithAnEffect) {
  // Calibrations drawn about the truth g(d) = d + 0.02 sin(3 d) by the covariance that they state: 2000 squares over the
  // variance are chi-square, sqrt(2 / 2000) = 0.032 apart, four of these allowed.
  EffectsCovariance known{{"cyclic_error.sine_m", "cyclic_error.wavenumber_per_m"},
                          Eigen::MatrixXd::Zero(5, 5)};
  known.matrix.diagonal() << 4e-6, 1e-6, 0.0, 9e-6, 1e-4;
  known.matrix(0, 3) = known.matrix(3, 0) = -4e-6;
  const Eigen::LLT<Eigen::Matrix4d> factor(
      known.matrix(std::vector{0, 1, 3, 4}, std::vector{0, 1, 3, 4}).eval());
  Random random(seed_from("EffectCorrector.Scatter"));
  const double d = 2.0, y = d + 0.02 * std::sin(3.0 * d);
  double square = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const Eigen::Vector4d off = factor.matrixL() * Eigen::Vector4d(random.normal(), random.normal(),
                                                                   random.normal(), random.normal());
    Calibration c = straight(
        "cyclic_error", {{"cosine_m", 0.0}, {"sine_m", 0.02 + off[2]}, {"wavenumber_per_m", 3.0 + off[3]}});
    c.alpha += Eigen::Vector3d(off[0], off[1], 0.0);
    c.effects_covariance = known;
    const CorrectionRoot root =
        EffectCorrector(c, {}).correct(y + 0.001 * random.normal(), {}).least_squares.at(0);
    square += std::pow((root.distance_m - d) / *root.std_dev_total_m, 2) / 2000.0;
  }
  EXPECT_NEAR(square, 1.0, 0.13);
}

TEST(EffectCorrector, MostLikelyDistancesAreMinimaOfTheNegativeLogLikelihood) {
  const double k = 20.0;
  Calibration c = straight("cyclic_error", {{"cosine_m", 0.0}, {"sine_m", 0.03}, {"wavenumber_per_m", k}});
  c.noise.law = NoiseLaw::f_squared;
  c.noise.parameters[0] = 0.02;
  const EffectCorrector corrector(c, {});
  const auto nll = [&](double y, double d) {
    const double s = 0.02 * d * d, z = (y - d - 0.03 * std::sin(k * d)) / s;
    return std::log(s) + 0.5 * z * z;
  };
  for (const double y : {0.9, 1.7, 3.1}) {
    const Correction found = corrector.correct(y, {});
    ASSERT_FALSE(found.maximum_likelihood.empty());
    for (const CorrectionRoot& root : found.maximum_likelihood) {
      const double d = root.distance_m;
      EXPECT_LT(nll(y, d), nll(y, d - 1e-4));
      EXPECT_LT(nll(y, d), nll(y, d + 1e-4));
    }
  }
}

}  // namespace
}  // namespace rangecal
