// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "rangecal/solvers/calibrate/residual_check.hpp"
#include "rangecal/solvers/calibrate/truth_score.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/paper_scene.hpp"

namespace rangecal {
namespace {

using ::testing::HasSubstr;

/// K stops 0.3 m apart on the x axis, landmarks given, noise 0.01 f^2, bearings 0.5 degrees.
Scene scene_with(int stops, std::vector<Eigen::Vector2d> positions, int repeats) {
  Scene scene = testing::paper_scene();
  scene.sensor = {"demo", "triangulation", 0.05, 20.0};
  for (int k = 0; k < stops; ++k) testing::add_stop(scene, {0.3 * k, 0.0, 0.0});
  for (std::size_t l = 0; l < positions.size(); ++l)
    scene.landmarks.push_back({"T" + std::to_string(l + 5), 0.0, {}});
  scene.positions = positions;
  scene.repeats = repeats;
  return scene;
}

const std::vector<Eigen::Vector2d> around{{0.4, 0.7}, {1.6, -0.6}, {2.3, 1.7}, {0.9, -2.3}, {2.5, 4.1}};

std::vector<Calibration> all_methods(const Recording& recording) {
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  return calibrate(std::span(&recording, 1), options);
}

TEST(Calibrate, FourMethodsWithEveryField) {
  const Recording recording = simulate(scene_with(10, around, 10), seed_from("four methods"));
  const std::vector<Calibration> all = all_methods(recording);
  ASSERT_EQ(all.size(), 4u);
  for (const Calibration& c : all) {
    EXPECT_EQ(c.outcome, Outcome::converged) << to_string(c.method) << c.reason;
    EXPECT_EQ(c.order(), 2);
    ASSERT_TRUE(c.alpha_covariance) << to_string(c.method);
    EXPECT_TRUE(c.sigma_theta_rad && c.sigma_theta_rad->std_dev);
    EXPECT_TRUE(c.joint_nll && c.marginal_nll && c.aic);
    EXPECT_EQ(c.counts.used, 500);
    ASSERT_EQ(c.landmarks.size(), 5u);
    EXPECT_EQ(c.landmarks[2].label, "T7");
    EXPECT_GT(c.range_max_m, 3.0);
  }
  EXPECT_EQ(all[3].stops.size(), 10u);
  EXPECT_EQ(all[3].stops[4].label, "4");
}

TEST(Calibrate, StopsInMillimetresAreAskedAbout) {
  Recording recording = simulate(scene_with(10, around, 10), seed_from("units"));
  CalibrateOptions options;
  options.methods = {Method::marginal};
  EXPECT_THAT(calibrate_report(std::span(&recording, 1), options).notes, ::testing::IsEmpty());
  for (Stop& stop : recording.stops) stop.commanded.x_m *= 1000.0;
  const CalibrationReport report = calibrate_report(std::span(&recording, 1), options);
  EXPECT_THAT(report.notes, ::testing::Contains(HasSubstr("stops (or taped distances) are in another unit")));
}

TEST(Calibrate, SaysWhatTheReadersNotedOnce) {
  std::vector<Recording> recordings;
  for (std::uint64_t seed = 0; seed < 2; ++seed)
    recordings.push_back(simulate(scene_with(10, around, 10), seed_from("reader notes", {seed})));
  recordings[0].notes = {"a column is left out"};
  recordings[1].notes = {"a column is left out", "another is"};
  CalibrateOptions options;
  options.methods = {Method::closed_form};
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  EXPECT_THAT(calibrate_report(recordings, options).notes,
              ::testing::ElementsAre("a column is left out", "another is"));
}

TEST(Calibrate, ReadingsWithoutNoiseAreCalledThat) {
  Scene scene = scene_with(10, around, 3);
  Recording recording = simulate(scene, seed_from("exact"));
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const Pose2& pose = recording.stops[static_cast<std::size_t>(recording.readings.stop[i])].commanded;
    const Eigen::Vector2d away = around[static_cast<std::size_t>(recording.readings.landmark[i])] -
                                 Eigen::Vector2d(pose.x_m, pose.y_m);
    recording.readings.range_m[i] = evaluate_polynomial(scene.alpha, away.norm());
    recording.readings.bearing_rad[i] = std::atan2(away.y(), away.x()) - pose.heading_rad;
  }
  const CalibrationReport report = calibrate_report(std::span(&recording, 1));
  for (const Calibration& c : report.calibrations) {
    EXPECT_EQ(c.outcome, Outcome::unbounded) << to_string(c.method);
    EXPECT_THAT(c.reason, HasSubstr("order 2"));
  }
  ASSERT_EQ(report.notes.size(), 2u);  // ranges, bearings
  EXPECT_THAT(report.notes[1], HasSubstr("every bearing"));
  EXPECT_THROW(diagnose(std::span(&recording, 1)), NoAnswerError);
  EXPECT_EQ(order_without_noise(make_joint_problem(std::span(&recording, 1)), 1, 4), 2);
  for (auto values :
       {&Readings::bearing_rad, &Readings::range_m}) {  // all of a landmark at a stop are off: that is noise
    Recording noisy = recording;
    for (std::size_t i = 0; i < noisy.readings.size(); ++i)
      if (noisy.readings.stop[i] == 4 && noisy.readings.landmark[i] == 2) (noisy.readings.*values)[i] += 1e-6;
    EXPECT_EQ(order_without_noise(make_joint_problem(std::span(&noisy, 1)), 1, 4), std::nullopt);
  }
}

TEST(Calibrate, OrderAndLawAreChosenByAic) {
  const Recording recording = simulate(scene_with(20, around, 10), seed_from("choice"));
  CalibrateOptions options;
  options.methods = {Method::marginal};
  const CalibrationReport report = calibrate_report(std::span(&recording, 1), options);
  ASSERT_EQ(report.calibrations.size(), 1u);
  EXPECT_EQ(report.calibrations[0].noise.law, NoiseLaw::f_squared);
  EXPECT_GE(report.calibrations[0].order(),
            2);  // order 1 is tens of nats worse; AIC may take one order too many
  EXPECT_GE(report.models.size(), 7u);
  // A lower order takes AIC's place where it predicts stops left out better; it is nearly as likely then.
  for (const ModelScore& model : report.models) EXPECT_LE(*report.calibrations[0].aic, model.aic + 0.05);
  // Orders 3 and 4 cost 2 each and gain something, so that they count in what the choice leaves open.
  ASSERT_TRUE(report.calibrations[0].covariance_with_choice);
  EXPECT_GE(report.calibrations[0].covariance_with_choice->rows(), 4);
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  EXPECT_FALSE(calibrate(std::span(&recording, 1), options)[0].covariance_with_choice);
}

/// f of the paper's scene with noise 0.01 f^2, or heavier tails, at distances from 0.4 to 4 m.
Recording paper_pairs(int count, bool outliers) {
  Random random(seed_from("paper_pairs", {static_cast<std::uint64_t>(count)}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  for (int i = 0; i < count; ++i) {
    const double d = random.uniform(0.4, 4.0), f = 0.0525 + 0.8838 * d + 0.0584 * d * d;
    const double error = random.normal() * (outliers && i % 10 == 0 ? 8.0 : 1.0);
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(f + 0.01 * f * f * error);
  }
  recording.counts.read = recording.counts.used = count;
  return recording;
}

CalibrationReport by_criterion(const Recording& recording, OrderCriterion criterion) {
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.criterion = criterion;
  return calibrate_report(std::span(&recording, 1), options);
}

TEST(Calibrate, TheCriterionOfPairsDecides) {
  const Recording recording = paper_pairs(60, false);
  for (const OrderCriterion criterion : {OrderCriterion::aic, OrderCriterion::aicc, OrderCriterion::bic}) {
    const CalibrationReport report = by_criterion(recording, criterion);
    const Calibration& c = report.calibrations[0];
    ASSERT_EQ(report.models.size(), 16u);
    const ModelScore* lowest = &report.models[0];
    for (const ModelScore& model : report.models)
      if (criterion_of(model, criterion, 60.0) < criterion_of(*lowest, criterion, 60.0)) lowest = &model;
    EXPECT_EQ(c.order(), lowest->order) << to_string(criterion);
    EXPECT_EQ(c.noise.law, lowest->law) << to_string(criterion);
    EXPECT_TRUE(report.notes.empty());
  }
  // AIC = 2 nll + 2 k with k = 4 (3 alpha, sigma_e), N = 60: AICc adds 2 * 4 * 5 / 55, BIC has 4 log 60 for 8.
  const ModelScore model{2, NoiseLaw::f_squared, -100.0, -192.0};
  EXPECT_NEAR(criterion_of(model, OrderCriterion::aicc, 60.0), -192.0 + 40.0 / 55.0, 1e-12);
  EXPECT_NEAR(criterion_of(model, OrderCriterion::bic, 60.0), -200.0 + 4.0 * std::log(60.0), 1e-12);
}

TEST(Calibrate, LeftOutReadingsChooseTheOrderOfPairs) {
  const Recording recording = paper_pairs(300, false);
  for (const OrderCriterion criterion : {OrderCriterion::cross_validation, OrderCriterion::thirds}) {
    const CalibrationReport report = by_criterion(recording, criterion);
    const Calibration& c = report.calibrations[0];
    EXPECT_EQ(c.noise.law, NoiseLaw::f_squared) << to_string(criterion);
    EXPECT_GE(c.order(), 2) << to_string(criterion);  // the bend of 0.2 m shows in any third
    EXPECT_EQ(c.counts.used, 300);                    // all readings make the curve
    ASSERT_EQ(report.notes.size(), 1u);
    EXPECT_THAT(report.notes[0], HasSubstr("mm at order 4"));
  }
  CalibrateOptions options;
  options.criterion = OrderCriterion::thirds;
  options.order = 2;
  EXPECT_THROW(calibrate(std::span(&recording, 1), options), InputError);
  options.order.reset();
  const Recording landmarks = simulate(scene_with(10, around, 1), seed_from("criterion"));
  EXPECT_THROW(calibrate(std::span(&landmarks, 1), options), InputError);
}

TEST(Calibrate, FewReadingsWithAShapeOfTheirOwnAreCautioned) {
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.methods = {Method::marginal};
  options.noise_shape = NoiseShape::student_t;
  for (const int count : {60, 200}) {
    const Recording recording = paper_pairs(count, true);
    const CalibrationReport report = calibrate_report(std::span(&recording, 1), options);
    const Calibration& c = report.calibrations[0];
    ASSERT_TRUE(c.alpha_covariance) << c.covariance_reason;
    const bool said = c.covariance_reason.find("few for a noise shape") != std::string::npos;
    EXPECT_EQ(said, count < 100) << c.covariance_reason;
    EXPECT_EQ(!report.notes.empty() && report.notes.back().find("few for a noise shape") != std::string::npos,
              count < 100);
  }
  options.noise_shape = NoiseShape::gaussian;
  const Recording recording = paper_pairs(60, true);
  EXPECT_TRUE(calibrate_report(std::span(&recording, 1), options).notes.empty());
}

TEST(Calibrate, FromStartsThereAndEndsAtTheSameOptimum) {
  const Recording recording = simulate(scene_with(10, around, 5), seed_from("from"));
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.methods = {Method::marginal};
  const Calibration first = calibrate(std::span(&recording, 1), options)[0];
  options.from = first;
  const Calibration again = calibrate(std::span(&recording, 1), options)[0];
  EXPECT_NEAR(*again.marginal_nll, *first.marginal_nll, 1e-7);
}

TEST(Calibrate, SigmaOfTheStopsIsEstimatedByMarginalOnly) {
  Recording recording = simulate(scene_with(40, around, 4), seed_from("sigma_s"));
  recording.estimate_sigma_xy = true;
  const std::vector<Calibration> all = all_methods(recording);
  EXPECT_EQ(all[2].outcome, Outcome::unbounded);
  EXPECT_THAT(all[2].reason, HasSubstr("marginal"));
  EXPECT_EQ(all[2].alpha.size(), 0);
  ASSERT_EQ(all[3].outcome, Outcome::converged) << all[3].reason;
  ASSERT_TRUE(all[3].sigma_s_m && all[3].sigma_s_m->std_dev);
  EXPECT_LT(std::abs(all[3].sigma_s_m->value - 0.01), 4.0 * *all[3].sigma_s_m->std_dev);  // truth: 1 cm

  CalibrateOptions options;
  options.methods = {Method::full};
  EXPECT_THROW(calibrate(std::span(&recording, 1), options), InputError);
}

/// One range in twenty is an echo 1 m behind its landmark, one bearing in twenty off by ten of its sigmas.
Recording with_outliers() {
  Recording recording = simulate(scene_with(15, around, 8), seed_from("outliers"));
  Random random(seed_from("which are outliers"));
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    if (random.uniform() < 0.05) recording.readings.range_m[i] += 1.0;
    if (random.uniform() < 0.05) recording.readings.bearing_rad[i] += random.normal(0.0, 0.087);
  }
  return recording;
}

TEST(Calibrate, NoiseShapesKeepTheCurveOfLandmarkRecordings) {
  const Recording recording = with_outliers();
  const Eigen::Vector3d row(1.0, 2.0, 4.0), truth(0.0525, 0.8838, 0.0584);
  const auto off = [&](const Calibration& c) {  // error of f at 2 m in its standard deviations
    return std::abs(row.dot(c.alpha - truth)) / std::sqrt(row.dot(*c.alpha_covariance * row));
  };
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  for (NoiseShape shape : {NoiseShape::student_t, NoiseShape::contaminated, NoiseShape::automatic}) {
    options.noise_shape = shape;
    const CalibrationReport report = calibrate_report(std::span(&recording, 1), options);
    for (std::size_t i : {2u, 3u}) {
      const Calibration& c = report.calibrations[i];
      ASSERT_EQ(c.outcome, Outcome::converged) << to_string(shape) << c.reason;
      ASSERT_GE(c.noise_shapes.size(), shape == NoiseShape::automatic ? 1u : 2u) << to_string(shape);
      EXPECT_EQ(c.noise_shapes.at("range").family, report.calibrations[3].noise_shapes.at("range").family);
      // The rule for all curves here: 4 standard deviations, 6e-5 by chance.
      EXPECT_LT(off(c), 4.0) << to_string(shape) << " " << to_string(c.method);
      ASSERT_TRUE(c.joint_nll && c.marginal_nll && c.aic);
    }
    const Calibration& full = report.calibrations[2];
    const Calibration& marginal = report.calibrations[3];
    if (full.noise_shapes.at("range").family == to_string(NoiseShape::contaminated)) {
      // 600 readings, share 0.05: binomial standard deviation 0.009; far echoes are told from the core one by one.
      EXPECT_NEAR(marginal.noise_shapes.at("range").parameters.at("outlier_share"), 0.05, 0.03);
    }
    ASSERT_TRUE(report.calibrations[0].aic);  // by the same functions, the shapes as marginal has them
    EXPECT_GT(*report.calibrations[0].aic, *marginal.aic);
    EXPECT_THAT(report.noise_shape, HasSubstr("bearing"));
  }
  options.noise_shape = NoiseShape::gaussian;
  options.methods = {Method::marginal};
  const Calibration gaussian = calibrate(std::span(&recording, 1), options)[0];
  options.noise_shape = NoiseShape::automatic;
  EXPECT_LT(*calibrate(std::span(&recording, 1), options)[0].aic, *gaussian.aic - 100.0);
}

TEST(Calibrate, AutomaticShapeOfCleanReadingsIsTheGaussianAnswer) {
  const Recording recording = simulate(scene_with(15, around, 8), seed_from("no outliers"));
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.noise_shape = NoiseShape::gaussian;
  const std::vector<Calibration> plain = calibrate(std::span(&recording, 1), options);
  options.noise_shape = NoiseShape::automatic;
  const CalibrationReport report = calibrate_report(std::span(&recording, 1), options);
  EXPECT_TRUE(report.noise_shape.empty()) << report.noise_shape;
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_TRUE(report.calibrations[i].noise_shapes.empty());
    // Ceres adds up in the order of its threads, so that its end varies in the last digits.
    EXPECT_TRUE(report.calibrations[i].alpha.isApprox(plain[i].alpha, 1e-8)) << i;
    EXPECT_NEAR(*report.calibrations[i].aic, *plain[i].aic, 1e-6) << i;
  }
}

TEST(Calibrate, OrderAndLawAreChosenWithTheShape) {
  const Recording recording = with_outliers();
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.noise_shape = NoiseShape::student_t;
  const CalibrationReport report = calibrate_report(std::span(&recording, 1), options);
  ASSERT_EQ(report.calibrations[0].outcome, Outcome::converged) << report.calibrations[0].reason;
  EXPECT_EQ(report.calibrations[0].noise.law, NoiseLaw::f_squared);
  // A lower order takes AIC's place where it predicts stops left out better; it is nearly as likely then.
  for (const ModelScore& model : report.models) EXPECT_LE(*report.calibrations[0].aic, model.aic + 4.0);
}

TEST(Calibrate, LandmarkThatNobodySeesIsLeftOutAndNamed) {
  Recording recording = simulate(scene_with(10, around, 5), seed_from("unseen"));
  recording.landmarks.insert(recording.landmarks.begin(), Landmark{"ghost", 0.0, {}});
  recording.truth.landmarks.insert(recording.truth.landmarks.begin(), std::nullopt);
  for (int& l : recording.readings.landmark) ++l;
  const CalibrationReport report = calibrate_report(std::span(&recording, 1), {});
  EXPECT_EQ(report.calibrations[3].outcome, Outcome::converged) << report.calibrations[3].reason;
  EXPECT_EQ(report.calibrations[3].landmarks.size(), 5u);
  ASSERT_FALSE(report.notes.empty());
  EXPECT_THAT(report.notes[0], HasSubstr("ghost"));
}

TEST(Calibrate, KindsDoNotMixAndNoneIsNothing) {
  const Recording landmarks = simulate(scene_with(10, around, 1), seed_from("mix"));
  Recording pairs;
  pairs.kind = RecordingKind::pairs;
  const std::vector<Recording> mixed{landmarks, pairs};
  EXPECT_THROW(calibrate(mixed), InputError);
  EXPECT_THROW(calibrate(std::span<const Recording>()), InputError);
}

// The recordings that a curve cannot be had from.

TEST(Degenerate, TwoStops) {
  for (const Calibration& c : all_methods(simulate(scene_with(2, around, 5), seed_from("two stops")))) {
    EXPECT_EQ(c.outcome, Outcome::too_few_data) << to_string(c.method);
    EXPECT_EQ(c.alpha.size(), 0);
  }
}

TEST(Degenerate, TwoLandmarksWithoutRepeatsHaveNoJointMaximum) {
  const std::vector<Calibration> all =
      all_methods(simulate(scene_with(10, {around[0], around[1]}, 1), seed_from("two landmarks")));
  EXPECT_EQ(all[2].outcome, Outcome::unbounded);
  EXPECT_EQ(all[2].alpha.size(), 0);
  // Either sigma can go, since a stop can zero its two ranges or its two bearings; the one that leads further is named.
  EXPECT_THAT(all[2].reason,
              ::testing::ContainsRegex("can be zeroed and sigma_(e|theta) goes to 0 \\(sigma_"));
  EXPECT_THAT(all[2].reason, HasSubstr("nats behind"));
  EXPECT_EQ(all[3].outcome, Outcome::converged) << all[3].reason;  // the marginal likelihood is bounded
}

TEST(Degenerate, LandmarksAndPathOnOneLine) {
  for (std::uint64_t seed = 0; seed < 5; ++seed) {
    const Recording recording = simulate(scene_with(10, {{4.0, 0.0}, {5.0, 0.0}, {6.0, 0.0}, {4.5, 0.0}}, 5),
                                         seed_from("collinear", {seed}));
    for (const Calibration& c : all_methods(recording)) {
      EXPECT_TRUE(c.outcome == Outcome::unobservable || c.outcome == Outcome::too_few_data)
          << to_string(c.method) << " " << to_string(c.outcome) << " seed " << seed;
      EXPECT_FALSE(c.alpha_covariance);
    }
  }
}

TEST(Degenerate, AllAtOneDistance) {
  Scene scene = scene_with(4, {{2.0, 0.0}, {0.0, 2.0}, {-2.0, 0.0}, {0.0, -2.0}}, 5);
  for (int k = 0; k < 4; ++k) scene.stops[k].commanded = {0.01 * (k % 2), 0.01 * (k / 2), 0.0};
  for (std::uint64_t seed = 0; seed < 5; ++seed)
    for (const Calibration& c : all_methods(simulate(scene, seed_from("one distance", {seed})))) {
      EXPECT_TRUE(c.outcome == Outcome::unobservable || c.outcome == Outcome::too_few_data)
          << to_string(c.method) << " " << to_string(c.outcome) << " seed " << seed;
      EXPECT_FALSE(c.alpha_covariance);
    }
}

TEST(Degenerate, StopsThatMayBeAnywhereAreNotCalledOneDistance) {
  Scene scene = scene_with(10, around, 5);
  Recording recording = simulate(scene, seed_from("sigma_xy"));
  recording.sigma_xy_m = 10.0;  // centimetres, most likely
  const std::vector<Calibration> all = all_methods(recording);
  for (const Calibration& c : {all[2], all[3]}) {  // the closed forms have too few distances that differ
    EXPECT_EQ(c.outcome, Outcome::unobservable) << to_string(c.method);
    EXPECT_THAT(c.reason, HasSubstr("sigma_xy_m lets a stop be off by 10 m")) << to_string(c.method);
    EXPECT_THAT(c.reason, ::testing::Not(HasSubstr("at about one distance")));
  }
}

TEST(Degenerate, LinesThatMissEachOtherAreNotTooFew) {
  // Headings off by -0.9, 0, 0.9 rad in turn: the lines of sight spread, and do not meet.
  Recording recording = simulate(scene_with(10, around, 5), seed_from("headings"));
  for (std::size_t k = 0; k < recording.stops.size(); ++k)
    recording.stops[k].commanded.heading_rad += 0.9 * (static_cast<double>(k % 3) - 1.0);
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.methods = {Method::closed_form};
  const Calibration c = calibrate(std::span(&recording, 1), options)[0];
  EXPECT_EQ(c.outcome, Outcome::unobservable) << c.reason;
  EXPECT_FALSE(c.weakest_direction.empty());
  EXPECT_EQ(c.alpha.size(), 3);  // one of the many curves, so that the file can be read again
  EXPECT_FALSE(c.alpha_covariance);
}

TEST(Degenerate, DirectionIsNamedByLabel) {
  const Recording recording = simulate(scene_with(10, {{4.0, 0.0}, {5.0, 0.0}, {6.0, 0.0}, {4.5, 0.0}}, 5),
                                       seed_from("collinear", {0}));
  EXPECT_THAT(all_methods(recording)[3].weakest_direction, HasSubstr("of landmark T"));
}

TEST(TruthScore, NoiseFreeCalibrationScoresItsBias) {
  // One landmark seen at d = 1 and d = 2 by f(d) = 0.1 + d; the calibration has f exactly, the landmark 3 cm
  // off in x.
  Recording recording;
  recording.stops.resize(2);
  recording.stops[0].label = "a";
  recording.stops[1].label = "b";
  recording.stops[1].commanded.x_m = -1.0;
  recording.landmarks = {{"L", 0.0, {}}};
  recording.readings.stop = {0, 1};
  recording.readings.landmark = {0, 0};
  recording.readings.range_m = {1.1, 2.1};
  recording.readings.bearing_rad = {0.0, 0.0};
  recording.truth.landmarks = {Eigen::Vector2d(1.0, 0.0)};
  recording.truth.stops = {Pose2{0.0, 0.0, 0.0}, Pose2{-1.0, 0.0, 0.0}};
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector2d(0.1, 1.0);
  c.noise.law = NoiseLaw::constant;
  c.range_min_m = 0.5;
  c.range_max_m = 3.0;
  c.landmarks = {{0, "L", {1.03, 0.0}, Eigen::Matrix2d::Identity() * 1e-4}};
  const TruthScore score = score_against_truth(std::span(&recording, 1), c);
  EXPECT_NEAR(*score.landmark_rmse_m, 0.03, 1e-12);
  EXPECT_NEAR(*score.landmark_strain, std::sqrt(0.5 * 0.03 * 0.03 / 1e-4), 1e-9);  // sqrt(e^2 / (2 sigma^2))
  EXPECT_NEAR(score.rmse_raw_m, 0.1, 1e-12);
  EXPECT_LT(score.rmse_corrected_m, 1e-9);
  EXPECT_FALSE(score.estimated_stops);
}

TEST(ResidualCheck, CountsWhatLiesBeyondFourSigma) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.pairs.true_m.assign(1000, 2.0);
  recording.pairs.reading_m.assign(1000, 2.0);
  Calibration c;
  c.alpha = Eigen::Vector2d(0.0, 1.0);
  c.noise.law = NoiseLaw::constant;  // sigma = 0.01 m: the limit is 2.04 m
  recording.pairs.reading_m[0] = 2.039;
  EXPECT_EQ(check_residuals(std::span(&recording, 1), c).range_outliers, 0);
  for (int i = 0; i < 5; ++i) recording.pairs.reading_m[i] = 2.041;
  const ResidualCheck check = check_residuals(std::span(&recording, 1), c);
  EXPECT_EQ(check.range_outliers, 5);
  EXPECT_TRUE(check.suspicious());
}

TEST(ResidualCheck, OneReadingFarOffIsEnough) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.pairs.true_m.assign(1000, 2.0);
  recording.pairs.reading_m.assign(1000, 2.0);
  for (int i = 0; i < 1000; ++i) recording.pairs.row.push_back(i + 2);
  Calibration c;
  c.alpha = Eigen::Vector2d(0.0, 1.0);
  c.noise.law = NoiseLaw::constant;       // sigma = 0.01 m
  recording.pairs.reading_m[55] = 2.045;  // 4.5 sigma: 1000 x 6.8e-6, by chance in one recording of 150
  EXPECT_FALSE(check_residuals(std::span(&recording, 1), c).suspicious());
  recording.pairs.reading_m[55] = 2.05;  // 5 sigma: 1000 x 5.7e-7, in one of 1700
  const ResidualCheck check = check_residuals(std::span(&recording, 1), c);
  EXPECT_TRUE(check.suspicious());
  EXPECT_EQ(check.farthest_range.place, "row 57 of pairs.csv");
  EXPECT_NEAR(check.farthest_range.sigmas, 5.0, 1e-9);
}

}  // namespace
}  // namespace rangecal
