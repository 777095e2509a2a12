// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/study/study.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

const std::string kScene =
    "format: rangecal-scene/1\n"
    "sensor: {alpha: [0.1, 0.9, 0.05], noise: {law: f, sigma: 0.05}, sigma_theta_rad: 0.01}\n"
    "stops: {line: {count: 6, step_m: 0.5}}\n"
    "landmarks: {list: [{landmark: A, x_m: 1, y_m: 1}, {landmark: B, x_m: 2, y_m: -1}, {landmark: C, x_m: 3, y_m: 2}]}\n";
const std::string kPairs =
    "format: rangecal-scene/1\nkind: pairs\nsensor: {alpha: [0, 1], noise: {law: f2, sigma: 0.01}}\n"
    "batches: {distances_m: [1, 2, 3], readings: 5}\n";
const std::string kHead = "format: rangecal-study/1\nname: s\nscene: scene.yaml\nrepeats: 10\n";
const std::string kTail = "estimators: [full]\nmeasures: [rmse]\n";

class StudyFile : public ::testing::Test {
 protected:
  StudyFile() {
    folder_.write("scene.yaml", kScene);
    folder_.write("pairs.yaml", kPairs);
  }
  Study load(const std::string& text) const {
    folder_.write("study.yaml", text);
    return load_study(folder_.file("study.yaml"));
  }
  std::string error_of(const std::string& text) const {
    try {
      load(text);
    } catch (const InputError& error) {
      return std::string(error.what()).substr(folder_.path().size() + 1);
    }
    return "no error";
  }
  test::TemporaryFolder folder_;
};

TEST_F(StudyFile, GridHoldsEveryCombinationTheLastFastest) {
  const Study study = load(kHead +
                           "grid:\n  - {parameter: sigma_s_m, values: [0.010, 2e-2]}\n"
                           "  - {parameter: landmarks, values: [1, 3, 2]}\n" +
                           kTail);
  ASSERT_EQ(study.points.size(), 6u);
  EXPECT_EQ(study.points[0].key, "sigma_s_m=0.01,landmarks=1");
  EXPECT_EQ(study.points[1].key, "sigma_s_m=0.01,landmarks=3");
  EXPECT_EQ(study.points[5].key, "sigma_s_m=0.02,landmarks=2");
  EXPECT_EQ(study.points[5].scene.positions.size(), 2u);
  EXPECT_DOUBLE_EQ(study.points[5].scene.sigma_xy_m, 0.02);
}

TEST_F(StudyFile, SeedsAreOfStudyPointAndRepeatAlone) {
  const Study one = load(kHead + "grid: [{parameter: landmarks, values: [2, 3]}]\n" + kTail);
  const Study more = load(kHead + "grid: [{parameter: landmarks, values: [1, 2, 3]}]\n" + kTail);
  EXPECT_EQ(study_seed(one, one.points[1], 7, "readings"), study_seed(more, more.points[2], 7, "readings"));
  EXPECT_NE(study_seed(one, one.points[1], 7, "readings"), study_seed(one, one.points[1], 8, "readings"));
  EXPECT_NE(study_seed(one, one.points[1], 7, "readings"), study_seed(one, one.points[0], 7, "readings"));
  EXPECT_NE(study_seed(one, one.points[1], 7, "readings"), study_seed(one, one.points[1], 7, "test"));
}

TEST_F(StudyFile, FingerprintSeesTheScenesAndNotTheRepeats) {
  const Study study = load(kHead + kTail);
  std::string more = kHead + kTail;
  more.replace(more.find("repeats: 10"), 11, "repeats: 90");
  EXPECT_EQ(load(more).fingerprint, study.fingerprint);
  EXPECT_NE(load(kHead + "piece: 5\n" + kTail).fingerprint, study.fingerprint);
  folder_.write("scene.yaml", kScene + "repeats: 2\n");
  EXPECT_NE(load(kHead + kTail).fingerprint, study.fingerprint);
}

TEST_F(StudyFile, EstimatorsCarryTheirOptions) {
  const Study study =
      load(kHead +
           "fit: {order: 3, noise: f2}\n"
           "estimators:\n  - marginal\n  - {method: closed-form, weights: paper}\n"
           "  - {method: closed-form, order: auto, criterion: thirds}\n  - {method: full, label: mine}\n"
           "measures: [rmse]\n");
  ASSERT_EQ(study.estimators.size(), 4u);
  EXPECT_EQ(study.estimators[0].label, "marginal");
  EXPECT_EQ(study.estimators[0].order, 3);
  EXPECT_EQ(study.estimators[1].label, "closed-form-paper");
  EXPECT_EQ(study.estimators[1].weights, BearingWeights::paper);
  EXPECT_EQ(study.estimators[2].label, "closed-form-thirds");
  EXPECT_FALSE(study.estimators[2].order.has_value());
  EXPECT_EQ(study.estimators[3].label, "mine");
  EXPECT_EQ(study.noise, NoiseLaw::f_squared);
}

TEST_F(StudyFile, CrossValidationHasTwoSpellingsAndOneLabel) {
  for (const std::string spelling : {"cv", "cross-validation"}) {
    const Study study =
        load(kHead + "estimators: [{method: closed-form, order: auto, criterion: " + spelling +
             "}]\nmeasures: [rmse]\n");
    ASSERT_EQ(study.estimators.size(), 1u);
    EXPECT_EQ(study.estimators[0].criterion, OrderCriterion::cross_validation) << spelling;
    EXPECT_EQ(study.estimators[0].label, "closed-form-cv") << spelling;
  }
}

TEST_F(StudyFile, WhatCannotBeIsOneLineThatNamesIt) {
  const auto says = [&](const std::string& text, const std::string& part) {
    const std::string error = error_of(text);
    EXPECT_NE(error.find(part), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos) << error;
  };
  says("format: rangecal-scene/1\n", "is not rangecal-study/1");
  says(kHead + kTail + "repeat: 5\n", "repeat");
  says(kHead + "grid: [{parameter: sigma, values: [1]}]\n" + kTail, "'sigma' is not a parameter");
  says(kHead + "grid: [{parameter: landmarks, values: [4]}]\n" + kTail, "the scene lists 3");
  says(kHead + "grid: [{parameter: landmarks, values: [1.5]}]\n" + kTail, "not a whole number");
  says(kHead + "grid: [{parameter: sigma_s_m, values: [0.1, 1e-1]}]\n" + kTail, "stands twice");
  says(kHead + "grid: [{parameter: noise_law, values: [polynomial]}]\n" + kTail, "other parameters");
  says(kHead + "grid: [{parameter: scene, values: [scene.yaml, pairs.yaml]}]\n" + kTail, "both kinds");
  says(kHead + "estimators: [fast]\nmeasures: [rmse]\n", "fast");
  says(kHead + "estimators: [full, full]\nmeasures: [rmse]\n", "stands twice");
  says(kHead + "estimators: [noise-order]\nmeasures: [rmse]\n", "needs a scene of kind pairs");
  says(kHead + "estimators: [{method: full, weights: paper}]\nmeasures: [rmse]\n", "only closed-form");
  says(kHead + "estimators: [full]\nmeasures: [speed]\n", "'speed' is not a measure");
  says(kHead + "estimators: [full]\nmeasures: [aic]\n", "aic needs a scene of kind pairs");
  says(kHead + "fit: {order: 12}\n" + kTail, "is above 9");
}

TEST(SceneParameters, BiasScaleMovesTheCurveFromTheDiagonal) {
  Scene scene;
  scene.alpha = Eigen::Vector3d(0.1, 0.9, 0.05);
  // f0(2) = 0.1 + 1.8 + 0.2 = 2.1, a bias of 0.1; twice that is 2.2, none is 2.
  EXPECT_NEAR(evaluate_polynomial(with_parameter(scene, "bias_scale", "2").alpha, 2.0), 2.2, 1e-15);
  EXPECT_NEAR(evaluate_polynomial(with_parameter(scene, "bias_scale", "0").alpha, 2.0), 2.0, 1e-15);
}

TEST(SceneParameters, StopsSpreadOverTheSamePath) {
  Scene scene;
  scene.stops.resize(3);
  scene.stops[2].commanded = {4.0, 2.0, 0.5};
  const Scene five = with_stops(scene, 5);
  ASSERT_EQ(five.stops.size(), 5u);
  EXPECT_DOUBLE_EQ(five.stops[1].commanded.x_m, 1.0);
  EXPECT_DOUBLE_EQ(five.stops[1].commanded.y_m, 0.5);
  EXPECT_DOUBLE_EQ(five.stops[4].commanded.x_m, 4.0);
}

}  // namespace
}  // namespace rangecal
