// SPDX-License-Identifier: BSD-3-Clause
// Recordings simulated from a calibration whose effects round the readings.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <vector>

#include "rangecal/solvers/diagnosis/simulation_model.hpp"
#include "support/add_reading.hpp"

namespace rangecal {
namespace {

/// Pairs at 1, 2, ... 12 m of a sensor that reads the distance.
SimulationModel exact_pairs() {
  SimulationModel model;
  Recording recording;
  recording.kind = RecordingKind::pairs;
  for (int i = 1; i <= 12; ++i) {
    recording.pairs.true_m.push_back(i);
    recording.pairs.reading_m.push_back(i);
    recording.pairs.time_s.push_back(0.1 * i);
  }
  model.recordings = {recording};
  model.calibration.kind = RecordingKind::pairs;
  model.calibration.alpha = Eigen::Vector2d(0.0, 1.0);
  model.calibration.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 1e-9)};
  return model;
}

TEST(SimulationLoop, ADisparityRoundedToZeroIsNoReading) {
  // Steps of 0.3 / m: 1 / y is rounded to 0 beyond 2 / 0.3 = 6.67 m, and 7 to 12 m are not read. 1 / 0.9 for 1 m; 2 m is
  // 1.67 steps, read as 1 / 0.6; 3 to 6 m are 1.1 to 0.56 steps, read as 1 / 0.3.
  SimulationModel model = exact_pairs();
  model.calibration.effects["quantisation"] = {{"disparity_step_per_m", 0.3}, {"output_step_m", 0.0}};
  const Recording again = simulate(model, 1).at(0);
  const std::vector<double> expected{1.0 / 0.9, 1.0 / 0.6, 1.0 / 0.3, 1.0 / 0.3, 1.0 / 0.3, 1.0 / 0.3};
  ASSERT_EQ(again.pairs.reading_m.size(), expected.size());
  ASSERT_EQ(again.pairs.time_s.size(), expected.size());
  for (std::size_t i = 0; i < expected.size(); ++i) {
    EXPECT_NEAR(again.pairs.reading_m[i], expected[i], 1e-12) << i;
    EXPECT_EQ(again.pairs.true_m[i], static_cast<double>(i + 1));
  }
  EXPECT_EQ(again.counts.used, 6);
}

TEST(SimulationLoop, ReadingsSitOnEveryGridOfTheModel) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  testing::add_landmarks(recording, 2);
  for (int k = 0; k < 5; ++k) {
    testing::add_stop(recording, {0.3 * k, 0.0, 0.0}, 0.0, 0.0);
    for (int l = 0; l < 2; ++l)
      for (int j = 0; j < 4; ++j) testing::add_reading(recording, k, l, j, 1.0, 0.0);
  }
  SimulationModel model;
  model.recordings = {recording};
  Calibration& c = model.calibration;
  c.alpha = Eigen::Vector2d(0.0, 1.0);
  c.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.003)};
  c.sigma_theta_rad = Estimate{0.01, std::nullopt};
  c.landmarks.resize(2);
  c.landmarks[0].label = "a", c.landmarks[0].position_m = {0.5, 1.3};
  c.landmarks[1].label = "b", c.landmarks[1].position_m = {1.0, -1.7};
  c.effects["quantisation"] = {{"disparity_step_per_m", 0.0}, {"output_step_m", 0.002}};
  c.effects["bearing_quantisation"] = {{"step_rad", 0.004}};
  const Recording again = simulate(model, 1).at(0);
  ASSERT_EQ(again.readings.size(), 40u);
  const auto off_grid = [](double value, double step) { return std::abs(std::remainder(value, step)); };
  for (std::size_t i = 0; i < again.readings.size(); ++i) {
    EXPECT_LT(off_grid(again.readings.range_m[i], 0.002), 1e-12);
    EXPECT_LT(off_grid(again.readings.bearing_rad[i], 0.004), 1e-12);
  }
}

}  // namespace
}  // namespace rangecal
