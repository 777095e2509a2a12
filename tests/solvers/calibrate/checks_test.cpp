// SPDX-License-Identifier: BSD-3-Clause
// Standard deviations by stops and by landmarks, and whether the curve is better than none.
#include <fmt/core.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <utility>

#include "calibrate/landmark_influence.hpp"
#include "calibrate/landmarks_job.hpp"
#include "calibrate/left_out_check.hpp"
#include "calibrate/reference_distances.hpp"
#include "calibrate/stop_influence.hpp"
#include "calibrate/walk_seed.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "support/recordings.hpp"

namespace rangecal {
namespace {

using ::testing::HasSubstr;

Scene field() { return load_scene(RANGECAL_SOURCE_DIR "/notebooks_data/scenes/field-layout.yaml"); }

Calibration by_order_two(const Recording& recording) {
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  return calibrate({&recording, 1}, options)[0];
}

/// Without the readings whose `indices` (of stops or landmarks) are this one.
Recording without_readings(const Recording& recording, const std::vector<int>& indices, int left_out) {
  Recording rest = recording;
  Readings& r = rest.readings;
  r = Readings{};
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    if (indices[i] == left_out) continue;
    r.stop.push_back(recording.readings.stop[i]);
    r.landmark.push_back(recording.readings.landmark[i]);
    r.repeat.push_back(recording.readings.repeat[i]);
    r.range_m.push_back(recording.readings.range_m[i]);
    r.bearing_rad.push_back(recording.readings.bearing_rad[i]);
  }
  return rest;
}

TEST(StopInfluence, OneStepEndsWhereTheFitWithoutTheStopDoes) {
  const Recording recording = simulate(field(), seed_from("influence"));
  const JointProblem problem = make_joint_problem({&recording, 1});
  const MarginalFit fit = solve_marginal(problem, position_seed(problem, 2, NoiseLaw::f_squared));
  ASSERT_EQ(fit.outcome, Outcome::converged);
  const auto influence = stop_influence(problem, fit.state, *fit.covariance);
  ASSERT_TRUE(influence);
  ASSERT_EQ(influence->groups(), 10);
  for (const int k : {0, 4, 9}) {
    const Recording rest = without_readings(recording, recording.readings.stop, k);
    const JointProblem others = make_joint_problem({&rest, 1});
    const MarginalFit refit = solve_marginal(others, fit.state);
    ASSERT_EQ(refit.outcome, Outcome::converged);
    // One Newton step where the fit takes several: within a fifth of a standard deviation of where it ends.
    for (int i = 0; i < 3; ++i) {
      const double std_dev = std::sqrt((*fit.covariance)(i, i));
      EXPECT_NEAR(influence->left_out[static_cast<std::size_t>(k)][i],
                  refit.state.alpha[i] - fit.state.alpha[i], 0.2 * std_dev)
          << k << ' ' << i;
    }
  }
}

TEST(StopInfluence, DeviationsByStopsAreTheModelsWhereItHolds) {
  // 40 worlds of 10 stops: each variance by stops has 9 degrees of freedom or fewer, their mean ratio a deviation of some
  // sqrt(2 / 9 / 40) = 7 %; a jackknife is known to be a little too wide in few groups.
  double ratio = 0.0;
  constexpr int worlds = 40;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    const Recording recording = simulate(field(), seed_from("by stops", {repeat}));
    const Calibration c = by_order_two(recording);
    ASSERT_TRUE(c.alpha_covariance_by_stops);
    const Eigen::Vector3d row(1.0, 2.0, 4.0);
    ratio += row.dot(*c.alpha_covariance_by_stops * row) / row.dot(*c.alpha_covariance * row) / worlds;
  }
  EXPECT_GT(ratio, 0.75);
  EXPECT_LT(ratio, 1.6);
}

/// 16 landmarks on a spiral, 0.5 to 4.5 m from the middle of five stops; four repeats.
Scene many_landmarks() {
  Scene scene = field();
  scene.stops.resize(5);
  for (int k = 0; k < 5; ++k)
    scene.stops[static_cast<std::size_t>(k)].commanded = {0.4 * k, 0.3 * (k % 2), 0.0};
  scene.landmarks.clear();
  scene.positions.clear();
  for (int l = 0; l < 16; ++l) {
    const double r = 0.9 + 0.24 * l, angle = 2.4 * l;
    scene.landmarks.push_back({fmt::format("L{}", l), 0.05, {}});
    scene.positions.push_back(Eigen::Vector2d(0.8 + r * std::cos(angle), 0.15 + r * std::sin(angle)));
  }
  scene.repeats = 4;
  return scene;
}

/// Each landmark adds to all of its ranges an error of its own, of so many metres RMS.
Recording with_shared_errors(const Scene& scene, double rms_m, const std::string& name,
                             std::uint64_t repeat) {
  Recording recording = simulate(scene, seed_from(name, {repeat}));
  Random random(seed_from("of landmarks", {repeat}));
  std::vector<double> own;
  for (std::size_t l = 0; l < recording.landmarks.size(); ++l) own.push_back(rms_m * random.normal());
  for (std::size_t i = 0; i < recording.readings.size(); ++i)
    recording.readings.range_m[i] += own[static_cast<std::size_t>(recording.readings.landmark[i])];
  return recording;
}

std::vector<std::string> labels_of(const Recording& recording) {
  std::vector<std::string> labels;
  for (const Landmark& landmark : recording.landmarks) labels.push_back(landmark.label);
  return labels;
}

TEST(LandmarkInfluence, OneStepEndsWhereTheFitWithoutTheLandmarkDoes) {
  const Recording recording = simulate(many_landmarks(), seed_from("influence of landmarks"));
  const JointProblem problem = make_joint_problem({&recording, 1});
  const MarginalFit fit = solve_marginal(problem, position_seed(problem, 2, NoiseLaw::f_squared));
  ASSERT_EQ(fit.outcome, Outcome::converged);
  const auto influence = landmark_influence(problem, labels_of(recording), fit.state, *fit.covariance);
  ASSERT_TRUE(influence);
  ASSERT_EQ(influence->groups, 16);
  Eigen::MatrixXd ends(3, 16);
  for (int l = 0; l < 16; ++l) {
    const Recording unread = without_readings(recording, recording.readings.landmark, l);
    const JointProblem others = make_joint_problem(with_seen_landmarks({&unread, 1}));
    JointState from = fit.state;
    from.landmarks.erase(from.landmarks.begin() + l);
    const MarginalFit refit = solve_marginal(others, from);
    ASSERT_EQ(refit.outcome, Outcome::converged);
    ends.col(l) = refit.state.alpha;
  }
  ends.colwise() -= ends.rowwise().mean().eval();
  const Eigen::MatrixXd refitted = 15.0 / 16.0 * ends * ends.transpose();
  for (const double d : {1.0, 2.0, 4.0}) {
    const Eigen::Vector3d row(1.0, d, d * d);
    EXPECT_NEAR(std::sqrt(row.dot(influence->jackknife * row) / row.dot(refitted * row)), 1.0, 0.1) << d;
  }
}

TEST(LandmarkInfluence, IsThereWhereMoreLandmarksThanStopsAreSeen) {
  Scene scene = many_landmarks();
  EXPECT_TRUE(by_order_two(simulate(scene, 1)).alpha_covariance_by_landmarks);
  EXPECT_FALSE(by_order_two(simulate(field(), 1)).alpha_covariance_by_landmarks);
  scene.stops.resize(3);  // too few to leave one out
  const Calibration c = by_order_two(simulate(scene, 1));
  EXPECT_FALSE(c.alpha_covariance_by_stops);
  ASSERT_TRUE(c.alpha_covariance_by_landmarks);
  ASSERT_TRUE(c.misfit);
  EXPECT_EQ(c.misfit->clusters, "landmarks");
}

TEST(LandmarkInfluence, DeviationsHoldWhereLandmarksHaveErrorsOfTheirOwn) {
  // 95 % intervals of f(2 m) in 100 worlds: 88 is three binomial deviations below. The misfit is said at three standard deviations of
  // six figures or so; more than 6 of 100 would be so in 1 of 100 runs if each world had 2 %.
  constexpr int worlds = 100;
  const Scene scene = many_landmarks();
  const Eigen::Vector3d row(1.0, 2.0, 4.0);
  int held = 0, held_by_model = 0, said_of_clean = 0, judged = 0, said = 0;
  double ratio = 0.0;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    const Calibration clean = by_order_two(with_shared_errors(scene, 0.0, "clean landmarks", repeat));
    ASSERT_TRUE(clean.alpha_covariance_by_landmarks);
    ratio +=
        row.dot(*clean.alpha_covariance_by_landmarks * row) / row.dot(*clean.alpha_covariance * row) / worlds;
    said_of_clean += !clean.misfit->holds();
    const Calibration c = by_order_two(with_shared_errors(scene, 0.05, "errors of landmarks", repeat));
    ASSERT_TRUE(c.alpha_covariance_by_landmarks);
    const double off = std::abs(row.dot(c.alpha - scene.alpha));
    held += off <= 1.96 * std::sqrt(row.dot(*c.alpha_covariance_by_landmarks * row));
    held_by_model += off <= 1.96 * std::sqrt(row.dot(*c.alpha_covariance * row));
    const Calibration far_off =
        by_order_two(with_shared_errors(scene, 0.10, "large errors of landmarks", repeat));
    if (!far_off.alpha_covariance_by_landmarks) continue;  // so large that curve and landmarks are one
    ++judged;
    said += !far_off.misfit->holds() && far_off.misfit->clusters == "landmarks";
  }
  EXPECT_GT(ratio, 0.85);
  EXPECT_LT(ratio, 1.25);
  EXPECT_LE(said_of_clean, 6);
  EXPECT_GE(held, 88);
  EXPECT_LE(held_by_model, 84);
  EXPECT_GE(judged, 90);
  EXPECT_GE(said, 65);
  RecordProperty("figures",
                 fmt::format("ratio {:.2f}, said of clean {}, held {}, by model {}, judged {}, said {}",
                             ratio, said_of_clean, held, held_by_model, judged, said));
}

TEST(Misfit, OfReadingsThatShareTheirStopsErrorIsSaid) {
  // Every stop adds 3 cm of its own to all of its ranges: the noise law knows of readings alone.
  Scene scene = field();
  int said = 0;
  constexpr int worlds = 10;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    Recording recording = simulate(scene, seed_from("shared errors", {repeat}));
    Random random(seed_from("of stops", {repeat}));
    std::vector<double> own;
    for (std::size_t k = 0; k < recording.stops.size(); ++k) own.push_back(0.06 * random.normal());
    for (std::size_t i = 0; i < recording.readings.size(); ++i)
      recording.readings.range_m[i] += own[static_cast<std::size_t>(recording.readings.stop[i])];
    CalibrateOptions options;
    options.methods = {Method::marginal};
    const Calibration c = calibrate({&recording, 1}, options)[0];
    said += c.misfit && !c.misfit->holds();
  }
  EXPECT_GE(said, 6);
}

TEST(LeftOut, ACurveThatHelpsIsUsableAndOneThatNoiseSwampsIsNot) {
  Scene helps = field(), swamped = field();
  swamped.alpha = Eigen::Vector3d(0.0, 1.0, 0.0);  // there is nothing to correct
  swamped.noise.parameters = Eigen::VectorXd::Constant(1, 0.05);
  int usable = 0, useless = 0;
  constexpr int worlds = 40;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    CalibrateOptions options;
    options.methods = {Method::marginal};
    const Recording good = simulate(helps, seed_from("helps", {repeat}));
    const Calibration c = calibrate({&good, 1}, options)[0];
    ASSERT_TRUE(c.left_out);
    usable += c.left_out->usable;
    EXPECT_LT(c.left_out->rms_corrected_m, 0.5 * c.left_out->rms_raw_m);
    const Recording bad = simulate(swamped, seed_from("swamped", {repeat}));
    const Calibration other = calibrate({&bad, 1}, options)[0];
    if (!other.left_out) continue;
    useless += !other.left_out->usable;
    if (!other.left_out->usable) {
      EXPECT_THAT(other.left_out->reason, HasSubstr("better than raw ones"));
    }
  }
  EXPECT_EQ(usable, worlds);
  EXPECT_GE(useless, 35);  // asked: 95 %; 38 of 40 less two binomial deviations of 1.4
}

TEST(LeftOut, OfPairsComparesWithTheKnownDistances) {
  Random random(seed_from("pairs left out"));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  for (int i = 0; i < 300; ++i) {
    const double d = random.uniform(0.3, 4.0), f = 0.05 + 0.9 * d;
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(f + 0.005 * f * f * random.normal());
  }
  recording.counts.read = recording.counts.used = 300;
  CalibrateOptions options;
  options.methods = {Method::marginal};
  const Calibration c = calibrate({&recording, 1}, options)[0];
  ASSERT_TRUE(c.left_out);
  EXPECT_TRUE(c.left_out->usable);
  EXPECT_EQ(c.left_out->groups, 25);  // stretches of consecutive readings
  // 0.1 d - 0.05 at 0.3 to 4 m: RMS sqrt(mean) = 0.19 m; noise of 0.005 f^2 / 0.9: 0.035 m.
  EXPECT_NEAR(c.left_out->rms_raw_m, 0.19, 0.02);
  EXPECT_NEAR(c.left_out->rms_corrected_m, 0.035, 0.01);
  ASSERT_TRUE(c.left_out->halves_p_value);
  EXPECT_GT(*c.left_out->halves_p_value, 1e-3);
}

/// 40 stops on a circle among the landmarks; every stop adds an error of its own to its ranges [m].
Recording walk(Scene scene, double own_error_m, int repeats, std::uint64_t repeat) {
  scene.stop_error = StopErrorModel::random_walk;
  scene.sigma_heading_rad = 0.01;
  scene.repeats = repeats;
  scene.stops.clear();
  for (int k = 0; k < 40; ++k) {
    Stop stop;
    stop.label = stop.place = std::to_string(k);
    const double at = 0.157 * k;
    stop.commanded = {1.5 + 0.7 * std::cos(at), 0.5 + 0.7 * std::sin(at), wrap_angle(at)};
    scene.stops.push_back(stop);
  }
  Recording recording = simulate(scene, seed_from("by stretches", {repeat}));
  Random random(seed_from("of stops of a walk", {repeat}));
  std::vector<double> own;
  for (int k = 0; k < 40; ++k) own.push_back(own_error_m * random.normal());
  for (std::size_t i = 0; i < recording.readings.size(); ++i)
    recording.readings.range_m[i] += own[static_cast<std::size_t>(recording.readings.stop[i])];
  return recording;
}

TEST(LeftOut, AlongAWalkACurveThatHelpsIsUsableAndOneThatNoiseSwampsIsNot) {
  int usable = 0, useless = 0;
  constexpr int worlds = 20;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    CalibrateOptions options;
    options.methods = {Method::marginal};
    const Recording good = walk(field(), 0.0, 2, repeat);
    const Calibration c = calibrate({&good, 1}, options)[0];
    ASSERT_TRUE(c.left_out);
    EXPECT_EQ(c.left_out->what, "stretches of the walk");
    EXPECT_EQ(c.left_out->groups, 19);  // of 20, without the first
    usable += c.left_out->usable;
    Scene swamped = field();
    swamped.alpha = Eigen::Vector3d(0.0, 1.0, 0.0);  // there is nothing to correct
    swamped.noise.parameters = Eigen::VectorXd::Constant(1, 0.05);
    const Recording bad = walk(swamped, 0.0, 2, repeat);
    const Calibration other = calibrate({&bad, 1}, options)[0];
    useless += !other.left_out || !other.left_out->usable;
  }
  EXPECT_EQ(usable, worlds);
  EXPECT_GE(useless, 16);  // asked: 95 %; 19 of 20 less three binomial deviations of 1.0
}

/// Squared errors of reference distances over their variances, averaged.
double error_over_variance(const Recording& recording, const JointState& state) {
  const JointProblem problem = make_joint_problem({&recording, 1});
  const ReferenceDistances reference(problem, state);
  const Cells& c = problem.cells;
  double sum = 0.0;
  int count = 0;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const auto known = reference.at(i);
    if (!known) continue;
    const Pose2& pose = *recording.truth.stops[static_cast<std::size_t>(c.stop[i])];
    const Eigen::Vector2d landmark = *recording.truth.landmarks[static_cast<std::size_t>(c.landmark[i])];
    const double d = (landmark - Eigen::Vector2d(pose.x_m, pose.y_m)).norm() - c.radius_m[i];
    sum += std::pow(known->d_m - d, 2) / known->variance_m2;
    ++count;
  }
  return count > 0 ? sum / count : std::nan("");
}

TEST(ReferenceDistances, ErrAsTheySayAndUseNoRange) {
  // The distances of a recording share the errors of its landmarks: their mean square over its expectation has a deviation of 0.9.
  for (const bool along_a_walk : {false, true}) {
    double mean = 0.0;
    const int worlds = along_a_walk ? 100 : 400;
    for (std::uint64_t repeat = 0; repeat < static_cast<std::uint64_t>(worlds); ++repeat) {
      Recording recording =
          along_a_walk ? walk(field(), 0.0, 2, repeat) : simulate(field(), seed_from("references", {repeat}));
      const JointProblem problem = make_joint_problem({&recording, 1});
      const MarginalFit fit =
          solve_marginal(problem, along_a_walk ? walk_seed(problem, 2, NoiseLaw::f_squared)
                                               : position_seed(problem, 2, NoiseLaw::f_squared));
      ASSERT_EQ(fit.outcome, Outcome::converged);
      mean += error_over_variance(recording, fit.state) / worlds;
      if (repeat > 0) continue;
      const ReferenceDistances reference(problem, fit.state);
      for (double& range_m : recording.readings.range_m) range_m *= 1.02;
      const ReferenceDistances other(make_joint_problem({&recording, 1}), fit.state);
      for (std::size_t i = 0; i < problem.cells.size(); ++i) {
        if (!reference.at(i)) continue;
        const auto [d, variance] = *reference.at(i);
        EXPECT_NEAR(other.at(i)->d_m, d, 0.01 * std::sqrt(variance));
        std::vector<double> alone(problem.cells.size(), 0.0);
        alone[i] = 2.0;
        EXPECT_NEAR(reference.variance_of_sum(alone), 4.0 * variance, 1e-8 * variance);
      }
    }
    EXPECT_NEAR(mean, 1.0, 3.3 * 0.9 / std::sqrt(worlds)) << along_a_walk;
  }
}

TEST(ReferenceDistances, ToALandmarkThatOneStopAloneSeesAreUnknown) {
  Recording recording = simulate(field(), seed_from("seen once"));
  Readings& r = recording.readings;
  const Readings all = std::exchange(r, Readings{});
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all.landmark[i] == 0 && all.stop[i] != 3) continue;
    r.stop.push_back(all.stop[i]);
    r.landmark.push_back(all.landmark[i]);
    r.repeat.push_back(all.repeat[i]);
    r.range_m.push_back(all.range_m[i]);
    r.bearing_rad.push_back(all.bearing_rad[i]);
  }
  const JointProblem problem = make_joint_problem({&recording, 1});
  const ReferenceDistances reference(problem, position_seed(problem, 2, NoiseLaw::f_squared));
  int known = 0;
  for (std::size_t i = 0; i < problem.cells.size(); ++i) {
    EXPECT_TRUE(problem.cells.landmark[i] != 0 || !reference.at(i));
    known += reference.at(i).has_value();
  }
  EXPECT_GT(known, static_cast<int>(problem.cells.size()) / 2);
}

TEST(StopInfluence, AlongAWalkDeviationsAreTheModelsWhereItHolds) {
  // 40 worlds of 19 stretches: each variance has 18 degrees of freedom or fewer, their mean ratio a deviation of some 5 %. The
  // misfit is said in 2 of 100 worlds; more than 4 of 40 are so in 1 of 1000 runs.
  double ratio = 0.0;
  int said = 0, groups = 0;
  constexpr int worlds = 40;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    const Recording recording = walk(field(), 0.0, 2, repeat);
    const JointProblem problem = make_joint_problem({&recording, 1});
    const MarginalFit fit = solve_marginal(problem, walk_seed(problem, 2, NoiseLaw::f_squared));
    ASSERT_EQ(fit.outcome, Outcome::converged);
    const auto influence = stop_influence(problem, fit.state, *fit.covariance);
    ASSERT_TRUE(influence);
    groups += influence->groups();
    EXPECT_EQ(influence->halves_difference.size(), 0);
    const Eigen::Vector3d row(1.0, 2.0, 4.0);
    ratio += row.dot(influence->covariance.topLeftCorner(3, 3) * row) /
             row.dot(fit.covariance->topLeftCorner(3, 3) * row) / worlds;
    const Calibration c = by_order_two(recording);
    said += c.misfit && !c.misfit->holds();
  }
  EXPECT_EQ(groups, 19 * worlds);  // of 20 stretches, without the first
  EXPECT_GT(ratio, 0.85);
  EXPECT_LT(ratio, 1.4);
  EXPECT_LE(said, 4);
}

TEST(Misfit, OfStopsAlongAWalkThatShareAnErrorIsSaid) {
  int said = 0;
  constexpr int worlds = 10;
  for (std::uint64_t repeat = 0; repeat < worlds; ++repeat) {
    const Recording recording = walk(field(), 0.06, 10, repeat);
    CalibrateOptions options;
    options.methods = {Method::marginal};
    const Calibration c = calibrate({&recording, 1}, options)[0];
    said += c.misfit && !c.misfit->holds();
  }
  EXPECT_GE(said, 6);
}

TEST(Outliers, AreListedWithWhatTheyAre) {
  Recording recording = simulate(field(), seed_from("listed"));
  Readings& r = recording.readings;
  std::size_t near = 0;  // where 1.5 m is far beyond noise
  while (near == 50 || near == 60 || !(r.range_m[near] > 1.0 && r.range_m[near] < 1.5)) ++near;
  r.range_m[near] += 1.5;
  r.range_m[50] -= 0.3 * r.range_m[50];
  const int labelled = r.landmark[60];
  r.landmark[60] = (labelled + 1) % static_cast<int>(recording.landmarks.size());
  CalibrateOptions options;
  options.methods = {Method::marginal};
  const Calibration c = calibrate({&recording, 1}, options)[0];
  ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
  EXPECT_GE(c.outlier_count, 3);
  ASSERT_GE(c.outliers.size(), 3u);
  const auto reason_of = [&](int row) {
    for (const OutlierReading& one : c.outliers)
      if (one.row == row) return one.reason;
    return std::string("not listed");
  };
  const auto row = [&](std::size_t i) { return i < r.row.size() ? r.row[i] : static_cast<int>(i) + 1; };
  EXPECT_EQ(reason_of(row(near)), "late echo");
  EXPECT_EQ(reason_of(row(50)), "early echo");
  EXPECT_EQ(reason_of(row(60)), "label of " + recording.landmarks[static_cast<std::size_t>(labelled)].label);
}

TEST(NoiseShapes, OfCamerasThatReportDepthTakeNoMoreThanTheyPredict) {
  // Depth reported as distance looks like early echoes or heavy tails. Landmarks lie 59 mm off on robot 1 with 23 % of early echoes, 8.6
  // degrees of sigma_theta and 384 mm off on robot 3 with Gaussian noise and its four gross bearings.
  struct Case {
    int robot;
    double landmarks_m;
  };
  for (const auto& [robot, landmarks_m] : {Case{1, 0.050}, Case{2, 0.037}, Case{3, 0.070}, Case{5, 0.040}}) {
    const std::filesystem::path folder =
        std::filesystem::path(testing::recordings()) / fmt::format("rangecal/mrclam6-robot{}", robot);
    RANGECAL_REQUIRE_RECORDING(folder);
    const Recording recording = load_recording(folder.string());
    CalibrateOptions options;
    options.methods = {Method::marginal};
    const Calibration c = calibrate({&recording, 1}, options).front();
    ASSERT_EQ(c.outcome, Outcome::converged) << robot << ' ' << c.reason;
    ASSERT_TRUE(c.left_out && c.misfit) << robot;
    double square = 0.0;
    for (std::size_t l = 0; l < c.landmarks.size(); ++l)
      square += (c.landmarks[l].position_m - *recording.truth.landmarks[l]).squaredNorm();
    EXPECT_LT(std::sqrt(square / static_cast<double>(c.landmarks.size())), landmarks_m) << robot;
    EXPECT_TRUE(!c.misfit->holds() || !c.left_out->usable) << robot;  // it is told
    EXPECT_TRUE(!c.left_out->usable || c.left_out->rms_corrected_m < c.left_out->rms_raw_m) << robot;
  }
}

TEST(LowerOrder, IsTakenWhereItPredictsStopsLeftOutBetter) {
  // An effect of another variable lets AIC bend the curve: order 4, where 2 predicts better. With a noise shape and without, and the closed forms
  // asked for alone get the same order.
  const Recording recording = load_recording(RANGECAL_SOURCE_DIR "/notebooks_data/concealed/world-07");
  CalibrateOptions options;
  for (const NoiseShape shape : {NoiseShape::automatic, NoiseShape::gaussian, NoiseShape::student_t}) {
    options.noise_shape = shape;
    options.methods = {Method::closed_form, Method::marginal};
    const CalibrationReport all = calibrate_report({&recording, 1}, options);
    EXPECT_THAT(all.notes, ::testing::Contains(HasSubstr("order 2 rather than 4, which has the lowest AIC")));
    ASSERT_EQ(all.calibrations[1].outcome, Outcome::converged);
    EXPECT_EQ(all.calibrations[1].order(), 2);
    EXPECT_EQ(all.calibrations[1].noise_shapes.empty(), shape != NoiseShape::student_t);
    options.methods = {Method::closed_form};
    const CalibrationReport alone = calibrate_report({&recording, 1}, options);
    EXPECT_EQ(alone.calibrations[0].alpha, all.calibrations[0].alpha);
    EXPECT_EQ(alone.calibrations[0].outcome, all.calibrations[0].outcome);
  }
}

TEST(ModelSearch, EndsAtTheOptimumOfAPoorModelToo) {
  // A noise law that is 400 nats behind: the log-determinant of stops that are short of their optimum is off by more than its line
  // search allowed for, so that it crept for a hundred iterations.
  const std::filesystem::path folder = std::filesystem::path(testing::recordings()) / "rangecal/brenner-lego";
  RANGECAL_REQUIRE_RECORDING(folder);
  const Recording recording = load_recording(folder.string());
  CalibrationReport report;
  const LandmarksJob job({&recording, 1}, {}, report);
  std::vector<TriedCurve> curves;
  const SearchedModels searched = job.choose_model(report.models, curves);
  EXPECT_EQ(report.models.size(), searched.fits.size());
  for (const auto& [model, fit] : searched.fits) {
    EXPECT_EQ(fit.outcome, Outcome::converged) << model.first << ' ' << to_string(model.second);
    EXPECT_LT(fit.gradient_norm, 1e-3) << model.first << ' ' << to_string(model.second);
    EXPECT_LT(fit.iterations, 30) << model.first << ' ' << to_string(model.second);
  }
  // A fit that starts there ends there.
  const MarginalFit* near = searched.at(searched.order, searched.law);
  ASSERT_NE(near, nullptr);
  const auto seed = job.seed(searched.order, searched.law);
  ASSERT_TRUE(seed);
  const MarginalFit settled = job.marginal(*seed, nullptr, near), from_seed = job.marginal(*seed, nullptr);
  EXPECT_NEAR(settled.marginal_nll, near->marginal_nll, 1e-3);
  EXPECT_NEAR(settled.marginal_nll, from_seed.marginal_nll, 1e-5);
}

}  // namespace
}  // namespace rangecal
