// SPDX-License-Identifier: BSD-3-Clause
// Pairs at one, two and three distances, without times or other columns: hardly anything can be asked of them; and
// landmarks whose readings leave the curve open.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/add_reading.hpp"

namespace rangecal {
namespace {

Recording pairs_at(const std::vector<double>& distances, int each) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from("diagnosis degenerate", {distances.size()}));
  for (const double d : distances)
    for (int i = 0; i < each; ++i) {
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(random.normal(0.05 + d, 0.005 * d * d));
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
    }
  return recording;
}

/// Six stops along x, each with five readings of every landmark: f = 0.05 + d, s = 0.005 d^2, stops to a centimetre.
Recording six_stops(const std::vector<Eigen::Vector2d>& landmarks, double step_m, std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  Random random(seed_from("diagnosis left open", {seed}));
  testing::add_landmarks(recording, landmarks.size());
  for (int k = 0; k < 6; ++k) {
    testing::add_stop(recording, {step_m * k, 0.0, 0.0}, 0.01);
    const Eigen::Vector2d at(random.normal(step_m * k, 0.01), random.normal(0.0, 0.01));
    for (std::size_t l = 0; l < landmarks.size(); ++l) {
      const Eigen::Vector2d way = landmarks[l] - at;
      const double d = way.norm();
      for (int i = 0; i < 5; ++i)
        testing::add_reading(recording, k, static_cast<int>(l), i, random.normal(0.05 + d, 0.005 * d * d),
                             std::atan2(way.y(), way.x()) + random.normal(0.0, 0.01));
    }
  }
  return recording;
}

/// The verdict says that nothing is determined, as calibrate does, and all that is written agrees.
void expect_open(const Recording& recording) {
  const std::vector<Recording> recordings{recording};
  const Diagnosis d = diagnose(recordings, {});
  EXPECT_EQ(d.verdict, Verdict::unobservable) << d.sentence;
  EXPECT_THAT(d.sentence, ::testing::StartsWith("Unobservable: "));
  EXPECT_TRUE(d.location.empty() && d.explanations.empty() && d.final_effects.empty() && d.unseen.empty());
  for (const Calibration& c : {d.baseline, d.corrected}) {
    EXPECT_EQ(c.outcome, Outcome::unobservable);
    EXPECT_FALSE(c.alpha_covariance);
    EXPECT_FALSE(c.weakest_direction.empty());
    for (const LandmarkEstimate& landmark : c.landmarks) EXPECT_FALSE(landmark.covariance) << landmark.label;
  }
  const auto json = nlohmann::json::parse(diagnosis_to_json(d));
  EXPECT_EQ(json.at("verdict"), "unobservable");
  for (const char* model : {"baseline", "final"}) {
    EXPECT_EQ(json.at(model).at("outcome"), "unobservable");
    EXPECT_EQ(json.at(model).at("weakest_direction"), d.corrected.weakest_direction);
    EXPECT_TRUE(json.at(model).at("parameters").at("alpha_0").at("std").is_null());
  }
  CalibrateOptions options;
  options.methods = {Method::marginal};
  const Calibration calibrated = calibrate(recordings, options).at(0);
  EXPECT_EQ(calibrated.outcome, Outcome::unobservable) << calibrated.reason;
}

TEST(DegenerateDiagnosis, OneDistanceDeterminesNoCurve) { expect_open(pairs_at({2.0}, 20)); }

TEST(DegenerateDiagnosis, LandmarksAtOneDistanceDetermineNoCurve) {
  expect_open(six_stops({{2.0, 0.0}, {0.0, 2.0}, {-2.0, 0.0}, {0.0, -2.0}}, 0.001, 1));
}

TEST(DegenerateDiagnosis, LandmarksAndPathOnOneLineDetermineNoCurve) {
  expect_open(six_stops({{4.0, 0.0}, {5.0, 0.0}, {6.0, 0.0}, {4.5, 0.0}}, 0.4, 2));
}

TEST(DegenerateDiagnosis, ACalibrationHoldsWhatThatOfCalibrateHolds) {
  const std::vector<Recording> recordings{
      six_stops({{1.0, 1.0}, {2.0, -1.2}, {3.5, 1.5}, {0.2, -2.0}}, 0.4, 3)};
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  const Calibration own = diagnose(recordings, options).baseline;
  CalibrateOptions same;
  same.methods = {Method::marginal};
  same.order = own.order();
  same.noise = own.noise.law;
  const Calibration c = calibrate(recordings, same).at(0);
  // Stopped at gradients of 1e-4 and 1e-7 standard deviations, at sigmas by REML, along which l_s still slopes.
  ASSERT_TRUE(own.joint_nll && own.marginal_nll && own.aic && c.aic);
  EXPECT_NEAR(*own.marginal_nll, *c.marginal_nll, 0.01);
  EXPECT_NEAR(*own.joint_nll, *c.joint_nll, 0.05);  // not at its own minimum, so that it moves to first order
  EXPECT_NEAR(*own.aic, *c.aic, 0.02);
  EXPECT_EQ(own.weakest_direction.empty(), c.weakest_direction.empty());
  ASSERT_EQ(own.landmarks.size(), c.landmarks.size());
  for (std::size_t l = 0; l < c.landmarks.size(); ++l) {
    ASSERT_TRUE(own.landmarks[l].covariance && c.landmarks[l].covariance) << l;
    EXPECT_LT((*own.landmarks[l].covariance - *c.landmarks[l].covariance).norm(),
              0.01 * c.landmarks[l].covariance->norm())
        << l;
  }
}

TEST(DegenerateDiagnosis, TwoDistancesShowALine) {
  const std::vector<Recording> recordings{pairs_at({2.0, 3.0}, 20)};
  const Diagnosis d = diagnose(recordings, {});
  EXPECT_EQ(d.verdict, Verdict::no_mismatch) << d.sentence;
  EXPECT_EQ(d.baseline.order(), 1);
  for (const Unseen& unseen : d.unseen) EXPECT_TRUE(std::isfinite(unseen.harm_m)) << unseen.effect;
}

TEST(DegenerateDiagnosis, ThreeDistances) {
  const std::vector<Recording> recordings{pairs_at({1.0, 2.0, 3.0}, 20)};
  EXPECT_EQ(diagnose(recordings, {}).verdict, Verdict::no_mismatch);
}

}  // namespace
}  // namespace rangecal
