// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/model_residuals.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// One stop at the origin looking along x, one landmark of radius 0.1 m with its axis at (2, 0): d = 1.9 m.
Recording one_landmark() {
  Recording recording;
  recording.stops.push_back({"S", {0.0, 0.0, 0.0}, {}, {}, "", {}});
  recording.landmarks.push_back({"A", 0.1, {}});
  Readings& r = recording.readings;
  r.stop = {0, 0};
  r.landmark = {0, 0};
  r.repeat = {0, 1};
  r.range_m = {2.05, 1.95};
  r.bearing_rad = {0.02, -0.01};
  r.row = {2, 3};
  r.covariates["warmth"] = {20.0, 21.0};
  return recording;
}

Calibration calibration() {
  Calibration c;
  c.alpha = Eigen::Vector2d(0.1, 1.0);  // f(d) = 0.1 + d, so f(1.9) = 2.0
  c.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.03)};
  c.sigma_theta_rad = Estimate{0.01, {}};
  c.landmarks.push_back({0, "A", {2.0, 0.0}, {}});
  return c;
}

TEST(ModelResiduals, AreTheReadingsLessTheModel) {
  const Recording recording = one_landmark();
  const std::vector<std::string> asked{"warmth", "sensor_bearing", "no such column"};
  const ModelResiduals result = model_residuals({&recording, 1}, calibration(), asked);
  ASSERT_EQ(result.readings.size(), 2u);
  const ReadingResidual& x = result.readings[0];
  EXPECT_EQ(x.row, 2);
  EXPECT_NEAR(x.distance_m, 1.9, 1e-15);
  EXPECT_NEAR(x.range_residual_m, 0.05, 1e-15);  // 2.05 - 2.0
  EXPECT_NEAR(x.corrected_m, 1.95, 1e-15);       // slope 1: 1.9 + 0.05
  EXPECT_NEAR(x.range_std_m, 0.03, 1e-15);
  EXPECT_NEAR(x.bearing_residual_rad, 0.02, 1e-15);
  EXPECT_NEAR(x.bearing_std_rad, 0.01, 1e-15);
  EXPECT_EQ(result.along.at("warmth"), (std::vector<double>{20.0, 21.0}));
  EXPECT_NEAR(result.along.at("sensor_bearing")[0], 0.0, 1e-15);
  EXPECT_EQ(result.along.count("no such column"), 0u);
}

TEST(ModelResiduals, TakeEffectsAndSmoothChangesAway) {
  const Recording recording = one_landmark();
  Calibration with_effect = calibration();
  with_effect.effects["range_offset"]["offset_m"] = 0.02;
  EXPECT_NEAR(model_residuals({&recording, 1}, with_effect).readings[0].range_residual_m, 0.03, 1e-15);
  AddedChange smooth;
  smooth.range_m = {0.04, 0.0};
  smooth.range_log_variance = {std::log(4.0), 0.0};
  const ModelResiduals result = model_residuals({&recording, 1}, calibration(), {}, {&smooth, 1});
  EXPECT_NEAR(result.readings[0].range_residual_m, 0.01, 1e-15);
  EXPECT_NEAR(result.readings[0].range_std_m, 0.06, 1e-15);  // twice 0.03
  EXPECT_NEAR(result.readings[1].range_residual_m, -0.05, 1e-15);
}

TEST(ModelResiduals, RefuseACalibrationThatPlacesNothing) {
  const Recording recording = one_landmark();
  Calibration no_curve = calibration(), no_place = calibration();
  no_curve.alpha.resize(0);
  no_place.landmarks.clear();
  EXPECT_THROW(model_residuals({&recording, 1}, no_curve), InputError);
  EXPECT_THROW(model_residuals({&recording, 1}, no_place), InputError);
}

TEST(ModelResiduals, BinsHoldEqualShares) {
  std::vector<double> values;
  for (int i = 0; i < 120; ++i) values.push_back(i);
  values.push_back(std::nan(""));
  const std::vector<int> bins = bins_of_equal_shares(values);
  EXPECT_EQ(bins.front(), 0);
  EXPECT_EQ(bins[119], 11);
  EXPECT_EQ(bins[120], -1);
}

}  // namespace
}  // namespace rangecal
