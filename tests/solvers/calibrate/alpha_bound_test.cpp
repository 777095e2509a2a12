// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/alpha_bound.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "support/calibration_of.hpp"
#include "support/paper_scene.hpp"

namespace rangecal {
namespace {

TEST(AlphaBound, MeanOfReadingsByHand) {
  // f = alpha_0, constant noise sigma = 0.02 m, 25 readings: sigma / sqrt(25), whatever the readings are.
  Recording recording;
  recording.kind = RecordingKind::pairs;
  for (int i = 0; i < 25; ++i) {
    recording.pairs.true_m.push_back(1.0 + 0.1 * i);
    recording.pairs.reading_m.push_back(2.0 + 0.003 * i);
  }
  Calibration c = testing::calibration_of(Eigen::VectorXd::Constant(1, 2.0), NoiseLaw::constant, 0.02);
  c.kind = RecordingKind::pairs;
  const auto bound = alpha_bound(std::span(&recording, 1), c);
  ASSERT_TRUE(bound);
  EXPECT_NEAR(bound->at_estimate[0], 0.02 / 5.0, 1e-12);
  EXPECT_FALSE(bound->at_truth);  // distances are true already, and no recording holds a true curve
  set_alpha_bounds(std::span(&recording, 1), std::span(&c, 1));
  ASSERT_TRUE(c.bound_alpha_std);
  EXPECT_EQ(*c.bound_alpha_std, bound->at_estimate);
  c.noise_shapes["range"].family = "student-t";  // a law of its own
  EXPECT_FALSE(alpha_bound(std::span(&recording, 1), c));
  set_alpha_bounds(std::span(&recording, 1), std::span(&c, 1));
  EXPECT_FALSE(c.bound_alpha_std);
}

/// Ten stops along x, five landmarks around, two repeats.
Recording along_a_line() {
  Scene scene = testing::paper_scene();
  scene.sensor = {"demo", "triangulation", 0.05, 20.0};
  for (int k = 0; k < 10; ++k) testing::add_stop(scene, {0.3 * k, 0.0, 0.0});
  testing::add_cylinders(scene);
  scene.repeats = 2;
  return simulate(scene, seed_from("AlphaBound"));
}

TEST(AlphaBound, OfLandmarksAtTheEstimateAndAtTheTruth) {
  Recording recording = along_a_line();
  const JointState truth = testing::truth_of(recording);
  Calibration c = testing::calibration_of(truth.alpha, NoiseLaw::f_squared, truth.noise.parameters[0]);
  c.sigma_theta_rad = Estimate{truth.sigma_theta_rad, std::nullopt};
  for (std::size_t l = 0; l < truth.landmarks.size(); ++l)  // 20 cm off, so that both bounds differ
    c.landmarks.push_back(
        {0, recording.landmarks[l].label, truth.landmarks[l] + Eigen::Vector2d(0.2, 0.0), {}});
  const auto bound = alpha_bound(std::span(&recording, 1), c);
  ASSERT_TRUE(bound && bound->at_truth);
  const auto expected = cramer_rao_bound(make_joint_problem(std::span(&recording, 1)), truth);
  for (int i = 0; i < 3; ++i) EXPECT_NEAR((*bound->at_truth)[i], std::sqrt((*expected)(i, i)), 1e-12) << i;
  EXPECT_GT((bound->at_estimate - *bound->at_truth).cwiseAbs().maxCoeff(), 1e-5);
  EXPECT_GT((bound->at_estimate.array() / bound->at_truth->array()).minCoeff(), 0.5);

  recording.truth.landmarks[2].reset();  // one place unknown: no bound there
  EXPECT_FALSE(alpha_bound(std::span(&recording, 1), c)->at_truth);
  recording.estimate_sigma_xy = true;  // the calibration has no sigma_s
  EXPECT_FALSE(alpha_bound(std::span(&recording, 1), c));
  recording.estimate_sigma_xy = false;
  c.landmarks.pop_back();  // of other recordings
  EXPECT_FALSE(alpha_bound(std::span(&recording, 1), c));
}

}  // namespace
}  // namespace rangecal
