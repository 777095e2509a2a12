// SPDX-License-Identifier: BSD-3-Clause
// Scenes whose sensor is of the model `optical`.
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "support/planted_scene.hpp"

namespace rangecal {
namespace {

using testing::planted_text;

Scene optical_scene(const std::string& fields) {
  return parse_scene(planted_text("", "model: optical" + fields), "optical", SceneScope::any);
}

Scene optical_pairs(const std::string& fields, const std::string& sigma) {
  return parse_scene("format: rangecal-scene/1\nkind: pairs\nsensor: {model: optical" + fields +
                         ", noise: {law: constant, sigma: " + sigma +
                         "}}\nbatches: {distances_m: [0.3, 0.5, 1, 2, 4], readings: 1}\n",
                     "optical pairs", SceneScope::any);
}

TEST(OpticalScene, IdealOpticsReadTheDistance) {
  // The same stops, landmarks and noise as those of the polynomial f(d) = d: the same readings, to rounding.
  const Recording optical = simulate(optical_scene(""), 3);
  const Recording plain = simulate(parse_scene(planted_text("", "alpha: [0, 1]"), "plain"), 3);
  EXPECT_EQ(optical.sensor.principle, "triangulation");
  EXPECT_EQ(optical.truth.landmarks, plain.truth.landmarks);
  EXPECT_EQ(optical.readings.stop, plain.readings.stop);
  EXPECT_EQ(optical.readings.time_s, plain.readings.time_s);
  ASSERT_EQ(optical.readings.size(), 1000u);
  for (std::size_t i = 0; i < optical.readings.size(); ++i) {
    EXPECT_NEAR(optical.readings.range_m[i], plain.readings.range_m[i], 1e-12);
    EXPECT_NEAR(wrap_angle(optical.readings.bearing_rad[i] - plain.readings.bearing_rad[i]), 0.0, 1e-12);
  }
  // Another baseline is another sensor, which its firmware knows.
  const Pairs other = simulate(optical_pairs(", baseline_mm: 75", "1e-9"), 1).pairs;
  for (std::size_t i = 0; i < other.size(); ++i) EXPECT_NEAR(other.reading_m[i], other.true_m[i], 1e-7);
}

/// x = f (s - d tan psi) / d on the detector, r = z + f' s / x: what a firmware reads that takes the focal length f' of
/// 14.4 mm for f of 14 mm, with s = 50 mm, psi = 0.2 mrad, z = 20 mm.
double implied(double d) { return 0.02 + 14.4 / 14.0 * d / (1.0 - d * std::tan(2e-4) / 0.05); }

const std::string known_optics =
    ", focal_mm: 14, nominal_focal_mm: 14.4, range_zero_m: 0.02, laser_angle_rad: 0.0002";

TEST(OpticalScene, TheCurveIsThatOfLensLaserAndFirmware) {
  const Recording recording = simulate(optical_pairs(known_optics, "1e-9"), 1);
  ASSERT_EQ(recording.pairs.size(), 5u);
  for (std::size_t i = 0; i < 5; ++i)
    EXPECT_NEAR(recording.pairs.reading_m[i], implied(recording.pairs.true_m[i]), 1e-7);
}

TEST(OpticalScene, ACalibrationFindsTheCurveThatTheOpticsImply) {
  const Recording recording = simulate(optical_scene(known_optics), seed_from("OpticalScene.Calibration"));
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.order = 2;  // of which the curve is to 0.2 mm
  options.noise = NoiseLaw::f_squared;
  const Calibration c = calibrate({&recording, 1}, options).front();
  ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
  ASSERT_TRUE(c.alpha_covariance);
  for (const double d : {0.5, 1.0, 2.0, 3.0}) {
    const Eigen::Vector3d powers(1.0, d, d * d);
    const double std_dev = std::sqrt(powers.dot(*c.alpha_covariance * powers));
    EXPECT_NEAR(evaluate_polynomial(c.alpha, d), implied(d), 5.0 * std_dev) << d;
    EXPECT_GT(implied(d) - d, 5.0 * std_dev) << d;  // far from the identity, for how well it is known
  }
}

TEST(OpticalScene, SwitchesDoWhatTheirNamesSay) {
  const auto change = [](const std::string& fields, double d) {
    Scene scene = optical_pairs(fields, "1e-9");
    scene.batches = {{d, 1}};
    return simulate(scene, 1).pairs.reading_m.at(0) - d;
  };
  // dr = -d^2 / (f s) dx: a shift of 1 um at 2 m over 720 mm^2 is -4 / 720e-6 * 1e-6 = -5.6 mm.
  EXPECT_NEAR(change(", detector_shift_mm: 0.001", 2.0), -0.00556, 5e-5);
  // dr = -k1 (f s)^2 / d: 0.001 * 0.00072^2 * 1e6 / 0.5 = 1.04 mm.
  EXPECT_NEAR(change(", k1_per_mm2: 0.001", 0.5), -0.00104, 1e-5);
  EXPECT_NEAR(change(", output_lsb_m: 0.01", 1.234), -0.004, 1e-7);
  // A step of 0.5 px of 6 um: x = 0.36 mm at 2 m is 120 steps; at 2.01 m it is 119.4 and rounds to 119: 0.72 / 0.357.
  EXPECT_NEAR(change(", centroid_step_px: 0.5", 2.0), 0.0, 1e-7);
  EXPECT_NEAR(change(", centroid_step_px: 0.5", 2.01), 0.72 / 0.357 - 2.01, 1e-7);
  // A spot of 0.2 px is pulled towards the middle of its pixel, by several hundredths of one.
  EXPECT_GT(std::abs(change(", spot_sigma_px: 0.2", 2.01)), 1e-3);
}

TEST(OpticalScene, ASpotOffTheDetectorIsNoReading) {
  // The laser leans by 20 mrad: the spot leaves the detector beyond 0.05 / 0.02 = 2.5 m.
  const Recording recording = simulate(optical_pairs(", laser_angle_rad: 0.02", "0.001"), 1);
  EXPECT_EQ(recording.counts.read, 5);
  EXPECT_EQ(recording.counts.used, 4);
  EXPECT_EQ(recording.counts.dropped.at("not finite"), 1);
}

}  // namespace
}  // namespace rangecal
