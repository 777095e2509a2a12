// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "support/landmark_reading.hpp"
#include "support/paper_scene.hpp"
#include "support/recordings.hpp"

namespace rangecal {
namespace {

using testing::reading_of;

struct Drive {
  int stops = 300, repeats = 2;
  NoiseLaw law = NoiseLaw::f_squared;
  double sigma_e = 0.01, sigma_xy = 0.01, sigma_heading = 0.0;
  bool shaped = false;  ///< each stop has a covariance of its own, of these sigmas
  bool walk = false;    ///< the errors are those of the steps
};

/// Stops on a Lissajous curve of 4 by 3 m, five cylinders about it, each seen from every stop.
Recording drive(const Drive& d, std::uint64_t repeat = 0) {
  Scene scene = testing::paper_scene();
  scene.noise = {d.law, Eigen::VectorXd::Constant(1, d.sigma_e)};
  scene.sigma_xy_m = d.sigma_xy;
  scene.sigma_heading_rad = d.sigma_heading;
  if (d.walk) scene.stop_error = StopErrorModel::random_walk;
  scene.repeats = d.repeats;
  for (int k = 0; k < d.stops; ++k)
    testing::add_stop(scene, testing::on_the_drive(k, d.sigma_heading > 0.0 ? 0.9 * k : 0.0));
  for (std::size_t k = 0; d.shaped && k < scene.stops.size(); ++k) {
    Eigen::Matrix3d Q;
    const double s = k % 2 ? 0.4 : -0.4;
    Q << 1.6, s, 0.3, s, 0.4, -0.2, 0.3, -0.2, 1.0;
    const Eigen::Vector3d sigmas(d.sigma_xy, d.sigma_xy, d.sigma_heading);
    scene.stops[k].covariance = sigmas.asDiagonal() * Q * sigmas.asDiagonal();
  }
  testing::add_cylinders(scene);
  return simulate(scene, seed_from("recursive landmarks", {repeat}));
}

RecursiveLandmarksOptions options_for(const Drive& d) {
  RecursiveLandmarksOptions options;
  options.law = d.law;
  options.sigma_xy_m = d.sigma_xy;
  options.sigma_heading_rad = d.sigma_heading;
  options.random_walk = d.walk;
  return options;
}

RecursiveLandmarks after(const Recording& r, const RecursiveLandmarksOptions& options) {
  RecursiveLandmarks tracked(options);
  for (std::size_t i = 0; i < r.readings.size(); ++i) tracked.add(reading_of(r, i));
  return tracked;
}

Calibration batch_of(const Recording& r, int order, NoiseLaw law) {
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.noise_shape = NoiseShape::gaussian;  // as a stream has it
  options.order = order;
  options.noise = law;
  return calibrate({&r, 1}, options)[0];
}

/// `marginal` from where stops and landmarks stand in truth: from the commanded path of a long random walk,
/// which ends far from where it was meant to, a search need not find the optimum.
Calibration batch_from_truth(const Recording& r, const Drive& d) {
  const JointProblem problem = make_joint_problem({&r, 1});
  JointState start = testing::truth_of(r);
  start.noise = {d.law, Eigen::VectorXd::Constant(1, d.sigma_e)};
  const MarginalFit fit = solve_marginal(problem, start);
  Calibration batch;
  batch.outcome = fit.outcome;
  batch.reason = fit.reason;
  batch.alpha = fit.state.alpha;
  batch.noise = fit.state.noise;
  batch.marginal_nll = fit.marginal_nll;
  const auto std_dev = [&](Eigen::Index i) { return std::sqrt((*fit.covariance)(i, i)); };
  const Eigen::Index alphas = batch.alpha.size(), sigmas = alphas + 2 * problem.landmark_count();
  batch.alpha_covariance = fit.covariance->topLeftCorner(alphas, alphas);
  const double sigma = batch.noise.parameters[0], theta = fit.state.sigma_theta_rad;
  batch.noise_estimates = {Estimate{sigma, sigma * std_dev(sigmas)}};
  batch.sigma_theta_rad = Estimate{theta, theta * std_dev(sigmas + 1)};
  for (int l = 0; l < problem.landmark_count(); ++l) {
    LandmarkEstimate landmark;
    landmark.label = r.landmarks[static_cast<std::size_t>(l)].label;
    landmark.position_m = fit.state.landmarks[static_cast<std::size_t>(l)];
    landmark.covariance = fit.covariance->block<2, 2>(alphas + 2 * l, alphas + 2 * l);
    batch.landmarks.push_back(landmark);
  }
  return batch;
}

/// The largest difference of any estimate, in standard deviations of the batch.
double largest_difference(const Calibration& ours, const Calibration& batch) {
  double largest = 0.0;
  const auto consider = [&](double a, double b, double std_dev) {
    largest = std::max(largest, std::abs(a - b) / std_dev);
  };
  for (Eigen::Index i = 0; i < batch.alpha.size(); ++i)
    consider(ours.alpha[i], batch.alpha[i], std::sqrt((*batch.alpha_covariance)(i, i)));
  consider(ours.noise.parameters[0], batch.noise.parameters[0], *batch.noise_estimates[0].std_dev);
  consider(ours.sigma_theta_rad->value, batch.sigma_theta_rad->value, *batch.sigma_theta_rad->std_dev);
  for (const LandmarkEstimate& b : batch.landmarks)
    for (const LandmarkEstimate& a : ours.landmarks)
      if (a.label == b.label)
        for (int k = 0; k < 2; ++k)
          consider(a.position_m[k], b.position_m[k], std::sqrt((*b.covariance)(k, k)));
  return largest;
}

TEST(RecursiveLandmarks, IsTheBatchAnswerWithinOneHundredthOfItsStandardDeviation) {
  Drive headings, many, coarse, shaped;
  headings.sigma_heading = 0.01;
  many.stops = 2000;
  coarse.sigma_xy = 0.03;
  coarse.sigma_e = 0.02;
  shaped.sigma_heading = 0.01;
  shaped.sigma_xy = 0.03;
  shaped.shaped = true;
  std::vector<Drive> drives{{}, headings, many, coarse, shaped};
  for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_cubed, NoiseLaw::d_squared}) {
    drives.emplace_back();
    drives.back().law = law;
    drives.back().sigma_e = law == NoiseLaw::f_cubed ? 0.004 : 0.015;
  }
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const Recording recording = drive(drives[i], i);
    const Calibration ours = after(recording, options_for(drives[i])).estimate(),
                      batch = batch_of(recording, 2, drives[i].law);
    ASSERT_EQ(ours.outcome, Outcome::converged) << i << " " << ours.reason;
    EXPECT_LT(largest_difference(ours, batch), 0.01) << "drive " << i;
    EXPECT_NEAR(*ours.marginal_nll, *batch.marginal_nll, 0.05);
    EXPECT_LT((*ours.alpha_covariance - *batch.alpha_covariance).norm(),
              0.02 * batch.alpha_covariance->norm());
    EXPECT_NEAR(*ours.noise_estimates[0].std_dev, *batch.noise_estimates[0].std_dev,
                0.02 * *batch.noise_estimates[0].std_dev);
    // a stop that is summed up stays where the answer of its time had it
    EXPECT_NEAR(ours.range_min_m, batch.range_min_m, 0.03);
    EXPECT_NEAR(ours.range_max_m, batch.range_max_m, 0.03);
  }
}

TEST(RecursiveLandmarks, IsTheBatchAnswerAlongARandomWalk) {
  Drive exact, headings, precise, many, shaped;
  exact.walk = headings.walk = precise.walk = many.walk = shaped.walk = true;
  headings.sigma_heading = 0.01;
  precise.sigma_xy =
      0.001;  // the past tells more of a stop than its own readings: the law of its pose matters
  precise.sigma_heading = 0.002;
  many.stops = 1500;
  many.sigma_heading = 0.005;
  shaped.sigma_xy = 0.03;
  shaped.sigma_heading = 0.01;
  shaped.shaped = true;
  const std::vector<Drive> drives{exact, headings, precise, many, shaped};
  for (std::size_t i = 0; i < drives.size(); ++i) {
    const Recording recording = drive(drives[i], 100 + i);
    const Calibration ours = after(recording, options_for(drives[i])).estimate(),
                      batch = batch_from_truth(recording, drives[i]);
    ASSERT_EQ(batch.outcome, Outcome::converged) << i << " " << batch.reason;
    ASSERT_EQ(ours.outcome, Outcome::converged) << i << " " << ours.reason;
    EXPECT_LT(largest_difference(ours, batch), 0.01) << "drive " << i;
    EXPECT_NEAR(*ours.marginal_nll, *batch.marginal_nll, 0.05) << "drive " << i;
    EXPECT_LT((*ours.alpha_covariance - *batch.alpha_covariance).norm(),
              0.02 * batch.alpha_covariance->norm())
        << "drive " << i;
    // how the whole is turned: the batch's Hessian lacks the log-determinant's own part and knows it less
    // well
    for (std::size_t l = 0; l < batch.landmarks.size(); ++l)
      EXPECT_LT((*ours.landmarks[l].covariance - *batch.landmarks[l].covariance).norm(),
                0.06 * batch.landmarks[l].covariance->norm())
          << "drive " << i;
  }
}

TEST(RecursiveLandmarks, LandmarksFromAFirstStopThatIsKnown) {
  // Then nothing of the whole's place and turn is open, and the landmarks' covariances are the batch's.
  Drive d;
  d.walk = true;
  d.sigma_heading = 0.01;
  Recording recording = drive(d, 110);
  recording.stops[0].commanded = *recording.truth.stops[0];
  recording.stops[0].sigma_xy_m = 1e-5;
  recording.stops[0].sigma_heading_rad = 1e-6;
  const Calibration ours = after(recording, options_for(d)).estimate(),
                    batch = batch_from_truth(recording, d);
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  EXPECT_LT(largest_difference(ours, batch), 0.01);
  EXPECT_NEAR(*ours.marginal_nll, *batch.marginal_nll, 0.05);
  for (std::size_t l = 0; l < batch.landmarks.size(); ++l)
    EXPECT_LT((*ours.landmarks[l].covariance - *batch.landmarks[l].covariance).norm(),
              0.02 * batch.landmarks[l].covariance->norm());
}

TEST(RecursiveLandmarks, StepsToStopsWithoutReadingsCount) {
  // Of every five stops one is read from; and 140 in a row, more than are ever held, are not.
  Drive d;
  d.walk = true;
  d.stops = 900;
  d.sigma_heading = 0.003;
  Recording recording = drive(d, 120);
  Readings seen;
  RecursiveLandmarks tracked(options_for(d));
  for (int k = 0; k < d.stops; ++k) {
    tracked.pass(recording.stops[static_cast<std::size_t>(k)]);
    if (k % 5 != 0 || (k > 400 && k < 540)) continue;
    for (std::size_t i = 0; i < recording.readings.size(); ++i) {
      if (recording.readings.stop[i] != k) continue;
      tracked.add(reading_of(recording, i));
      seen.stop.push_back(k);
      seen.landmark.push_back(recording.readings.landmark[i]);
      seen.range_m.push_back(recording.readings.range_m[i]);
      seen.bearing_rad.push_back(recording.readings.bearing_rad[i]);
    }
  }
  recording.readings = seen;
  const Calibration ours = tracked.estimate(), batch = batch_from_truth(recording, d);
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  // a pose that went 140 steps unseen has a law that is bent: 1.2 %
  EXPECT_LT(largest_difference(ours, batch), 0.02);
  EXPECT_TRUE(ours.counts.dropped.empty());
}

TEST(RecursiveLandmarks, TurnsOnTheSpotAlongARandomWalk) {
  // Each place is read from twice, the sensor turned by a half between: no step, an error of the heading
  // alone.
  Drive d;
  d.walk = true;
  d.stops = 240;
  d.sigma_heading = 0.01;
  Scene scene = testing::paper_scene();
  scene.sigma_xy_m = d.sigma_xy;
  scene.sigma_heading_rad = d.sigma_heading;
  scene.stop_error = StopErrorModel::random_walk;
  for (int k = 0; k < d.stops; ++k) {
    const int at = k / 2;
    testing::add_stop(scene, testing::on_the_drive(at, 0.4 * at + 3.0 * (k % 2)));
    scene.stops.back().place = fmt::format("at {}", at);
  }
  testing::add_cylinders(scene);
  const Recording recording = simulate(scene, seed_from("turns along a walk"));
  const Calibration ours = after(recording, options_for(d)).estimate(),
                    batch = batch_from_truth(recording, d);
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  EXPECT_LT(largest_difference(ours, batch), 0.01);
  RecursiveLandmarks back(options_for(d));
  for (std::size_t i = 0; i < 30; ++i) back.add(reading_of(recording, i));
  LandmarkReading again = reading_of(recording, 30);
  again.stop.label = "new";
  again.stop.place = "at 0";
  EXPECT_THROW(back.add(again), InputError);
}

TEST(RecursiveLandmarks, IsTheBatchWhileAllStopsAreHeld) {
  // solve_marginal is the same, its start is another: both end within their tolerance of 1e-7 Fisher-scaled
  // units
  Drive few;
  few.stops = 12;
  for (const bool walk : {false, true}) {
    few.walk = walk;
    const Recording recording = drive(few, 20);
    EXPECT_LT(
        largest_difference(after(recording, options_for(few)).estimate(), batch_of(recording, 2, few.law)),
        1e-3);
  }
}

TEST(RecursiveLandmarks, LandmarksFromBearingsAreTheBatchAnswer) {
  for (const auto& [sigma_heading, walk] :
       {std::pair{0.0, false}, {0.02, false}, {0.0, true}, {0.002, true}}) {
    Drive d;
    d.sigma_heading = sigma_heading;
    d.walk = walk;
    const Recording recording = drive(d, 30);
    const std::vector<LandmarkFromBearings> ours = after(recording, options_for(d)).from_bearings();
    BearingOptions bearings;
    bearings.sigma_theta_rad = RecursiveLandmarksOptions{}.sigma_theta_rad;
    const LandmarksFromBearings batch =
        landmarks_from_bearings(make_joint_problem({&recording, 1}), bearings);
    ASSERT_EQ(ours.size(), batch.landmarks.size());
    for (std::size_t l = 0; l < ours.size(); ++l) {
      ASSERT_EQ(ours[l].outcome, Outcome::converged) << ours[l].reason;
      EXPECT_LT((ours[l].position_m - batch.landmarks[l].position_m).norm(), 1e-8);
      EXPECT_LT((ours[l].covariance - batch.landmarks[l].covariance).norm(),
                1e-8 * batch.landmarks[l].covariance.norm());
      EXPECT_NEAR(ours[l].condition, batch.landmarks[l].condition, 1e-8 * batch.landmarks[l].condition);
      EXPECT_EQ(ours[l].cells, d.stops);
    }
  }
}

TEST(RecursiveLandmarks, BearingsThatDetermineNothingAreNamed) {
  // Two lines along x from stops on the x axis, at distance 3 +- 0: parallel. One line: seen from one stop.
  RecursiveBearings bearings;
  EXPECT_EQ(bearings.landmark().outcome, Outcome::too_few_data);
  RecursiveBearings::Line line{{0.0, 0.0}, 0.0, 3.0, 1.0, 0.01, 0.0, 0.01};
  bearings.add(line);
  EXPECT_EQ(bearings.landmark().outcome, Outcome::unobservable);
  line.stop_m = {1.0, 0.0};
  bearings.add(line);
  EXPECT_EQ(bearings.landmark().outcome, Outcome::unobservable);
  EXPECT_NE(bearings.landmark().reason.find("parallel"), std::string::npos);
  // From (0, 0) along +x and from (2, -2) along -y: the lines meet at (2, 0), behind the second stop, 1 m
  // ahead on the whole.
  RecursiveBearings crossed;
  crossed.add({{0.0, 0.0}, 0.0, 2.0, 1.0, 0.01, 0.0, 0.01});
  crossed.add({{2.0, -2.0}, 1.5707963267948966, 2.0, 1.0, 0.01, 0.0, 0.01});
  ASSERT_EQ(crossed.landmark().outcome, Outcome::converged);
  EXPECT_LT((crossed.landmark().position_m - Eigen::Vector2d(2.0, 0.0)).norm(), 1e-12);
  // variance across each line: 0.01^2 + (0.01 * 2)^2 = 5e-4
  EXPECT_LT((crossed.landmark().covariance - 5e-4 * Eigen::Matrix2d::Identity()).norm(), 1e-15);
  RecursiveBearings behind;
  behind.add({{0.0, 0.0}, 3.141592653589793, 2.0, 1.0, 0.01, 0.0, 0.01});
  behind.add({{2.0, -2.0}, -1.5707963267948966, 2.0, 1.0, 0.01, 0.0, 0.01});
  EXPECT_EQ(behind.landmark().outcome, Outcome::unobservable);
}

TEST(RecursiveLandmarks, TakesLandmarksThatAppearLate) {
  Recording recording = drive({}, 40);
  Readings seen;
  for (std::size_t i = 0; i < recording.readings.size();
       ++i) {  // D from stop 100 on, E until 50 and from 200 on
    const int l = recording.readings.landmark[i], k = recording.readings.stop[i];
    if ((l == 3 && k < 100) || (l == 4 && k >= 50 && k < 200)) continue;
    seen.stop.push_back(k);
    seen.landmark.push_back(l);
    seen.range_m.push_back(recording.readings.range_m[i]);
    seen.bearing_rad.push_back(recording.readings.bearing_rad[i]);
  }
  recording.readings = seen;
  const Calibration ours = after(recording, options_for({})).estimate(),
                    batch = batch_of(recording, 2, NoiseLaw::f_squared);
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  ASSERT_EQ(ours.landmarks.size(), 5u);
  EXPECT_LT(largest_difference(ours, batch), 0.01);
}

TEST(RecursiveLandmarks, TracksTheOrder) {
  RecursiveLandmarksOptions options;
  options.order.reset();
  const Recording recording = drive({}, 50);
  const Calibration ours = after(recording, options).estimate();
  CalibrateOptions all;
  all.methods = {Method::marginal};
  all.noise_shape = NoiseShape::gaussian;
  all.max_order = 3;
  all.noise = NoiseLaw::f_squared;
  const Calibration batch = calibrate({&recording, 1}, all)[0];
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  ASSERT_EQ(ours.order(), batch.order());
  EXPECT_NEAR(*ours.aic, *batch.aic, 0.1);
  EXPECT_LT(largest_difference(ours, batch),
            0.02);  // summed up about the curve of order 3, some deviations away
}

TEST(RecursiveLandmarks, ForgetsWithItsTimeConstant) {
  // An offset of the readings creeps from 0 to 0.1 m in 1000 stops, 10 mm in 100. At 1.5 m the curve has the
  // weighted mean over the stops remembered: 0.1 m less a lag of 70 to 100 stops, a block being taken whole;
  // without forgetting the middle of the stream.
  Recording recording = drive({1000, 1}, 60);
  for (std::size_t i = 0; i < recording.readings.size(); ++i)
    recording.readings.range_m[i] += 1e-4 * recording.readings.stop[i];
  const auto offset = [](const Calibration& fit) {
    return evaluate_polynomial(fit.alpha - Eigen::Vector3d(0.0525, 0.8838, 0.0584), 1.5);
  };
  RecursiveLandmarksOptions options;
  EXPECT_NEAR(offset(after(recording, options).estimate()), 0.05, 0.006);
  options.forget = 100.0;
  RecursiveLandmarks recent = after(recording, options);
  const Calibration fit = recent.estimate();
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_NEAR(offset(fit), 0.0915, 0.006);
  // sum over ages of e^(-age / 100), squared, over the sum of e^(-2 age / 100): 200 stops
  EXPECT_NEAR(recent.effective_stops(), 200.0, 20.0);
}

TEST(RecursiveLandmarks, IntervalsHold) {
  // 100 streams of 80 stops, with and without forgetting, and along a random walk; |alpha_1 - truth| < 1.96
  // standard deviations in 0.95 of them, binomial: 4 * sqrt(0.95 * 0.05 / 100) = 0.087
  constexpr double never = std::numeric_limits<double>::infinity();
  for (const auto& [forget, walk] : {std::pair{never, false}, {60.0, false}, {never, true}}) {
    Drive d{80, 1};
    d.walk = walk;
    d.sigma_heading = walk ? 0.005 : 0.0;
    RecursiveLandmarksOptions options = options_for(d);
    options.forget = forget;
    int held = 0;
    for (std::uint64_t repeat = 0; repeat < 100; ++repeat) {
      const Calibration fit = after(drive(d, 1000 + repeat), options).estimate();
      ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
      held += std::abs(fit.alpha[1] - 0.8838) < 1.96 * std::sqrt((*fit.alpha_covariance)(1, 1));
    }
    EXPECT_NEAR(held / 100.0, 0.95, 0.087) << forget << walk;
  }
}

TEST(RecursiveLandmarks, CovariancesOfForgettingHoldForLandmarksOfLongAgo) {
  // Landmark D is seen from the first 16 of 80 stops alone, and these count by e^-1.5. z^2 = e^T C^-1 e / 2 of its place,
  // of 40 streams, has mean 1 and variance 1 / 40: +- 4 / sqrt(40) = 0.63. With one factor sum w^2 / sum w for all it is
  // 0.28. E, seen all along, and the curve at 2 m hold as well: +- 0.63 and +- 4 sqrt(2 / 40) = 0.89.
  const Drive d{80, 2};
  RecursiveLandmarksOptions options = options_for(d);
  options.forget = 32.0;
  options.block = 16;
  options.order = 1;
  double old = 0.0, fresh = 0.0, curve = 0.0;
  constexpr int streams = 40;
  for (std::uint64_t repeat = 0; repeat < streams; ++repeat) {
    Scene scene = testing::paper_scene();
    scene.alpha = Eigen::Vector2d(0.05, 0.9);
    scene.noise = {d.law, Eigen::VectorXd::Constant(1, d.sigma_e)};
    scene.sigma_xy_m = d.sigma_xy;
    scene.repeats = d.repeats;
    for (int k = 0; k < d.stops; ++k) testing::add_stop(scene, testing::on_the_drive(k, 0.0));
    testing::add_cylinders(scene);
    const Recording recording = simulate(scene, seed_from("recursive long ago", {repeat}));
    RecursiveLandmarks tracked(options);
    for (std::size_t i = 0; i < recording.readings.size(); ++i) {
      const int l = recording.readings.landmark[i];
      if (l != 1 && (l != 3 || recording.readings.stop[i] < 16)) tracked.add(reading_of(recording, i));
    }
    const Calibration fit = tracked.estimate();
    ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
    for (const LandmarkEstimate& landmark : fit.landmarks) {
      for (const std::size_t l : {std::size_t{3}, std::size_t{4}}) {
        if (landmark.label != recording.landmarks[l].label) continue;
        const Eigen::Vector2d off = landmark.position_m - *recording.truth.landmarks[l];
        (l == 3 ? old : fresh) += 0.5 * off.dot(landmark.covariance->inverse() * off) / streams;
      }
    }
    const Eigen::Vector2d at(1.0, 2.0);
    const double off = at.dot(fit.alpha - Eigen::Vector2d(0.05, 0.9));
    curve += off * off / at.dot(*fit.alpha_covariance * at) / streams;
  }
  EXPECT_NEAR(old, 1.0, 0.63);
  EXPECT_NEAR(fresh, 1.0, 0.63);
  EXPECT_NEAR(curve, 1.0, 0.89);
}

TEST(RecursiveLandmarks, TakesStatesThatKeepNoSquaredSums) {
  // Version 1: the second sums begin as the first times sum w^2 / sum w, which moves no estimate.
  RecursiveLandmarksOptions options;
  options.forget = 40.0;
  RecursiveLandmarks now = after(drive({100, 1}, 75), options);
  nlohmann::ordered_json state = nlohmann::ordered_json::parse(now.to_json());
  ASSERT_TRUE(state.at("squared").is_object());
  nlohmann::ordered_json broken = state;
  broken["squared"]["half_width"] = 0.123;
  EXPECT_THROW(RecursiveLandmarks::from_json(broken.dump(), "state"), InputError);
  broken.erase("squared");
  EXPECT_THROW(RecursiveLandmarks::from_json(broken.dump(), "state"), InputError);
  for (const char* later :
       {"squared", "past", "tried_at", "anew_stops", "stops_left_out", "noise_shape", "shapes",
        "range_residuals", "bearing_residuals", "gap", "squared_gap", "outliers"})
    ASSERT_EQ(state.erase(later), 1u) << later;
  state["format"] = "rangecal-recursive-landmarks/1";
  RecursiveLandmarks before = RecursiveLandmarks::from_json(state.dump(), "state");
  const Calibration ours = before.estimate(), truth = now.estimate();
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  EXPECT_EQ(ours.alpha, truth.alpha);
  // all landmarks are seen all along: one factor is nearly right
  EXPECT_LT((*ours.alpha_covariance - *truth.alpha_covariance).norm(), 0.5 * truth.alpha_covariance->norm());
}

TEST(RecursiveLandmarks, ManyLandmarksGoWithoutTheThirdOrder) {
  Scene scene = testing::paper_scene();
  for (int k = 0; k < 120; ++k) testing::add_stop(scene, testing::on_the_drive(k, 0.0));
  for (int l = 0; l < 36; ++l) {
    scene.landmarks.push_back({fmt::format("L{}", l), 0.05, {}});
    scene.positions.emplace_back((2.8 + 0.3 * (l % 3)) * std::cos(l * 0.1745),
                                 (2.4 + 0.3 * (l % 2)) * std::sin(l * 0.1745));
  }
  const Recording recording = simulate(scene, seed_from("recursive many landmarks"));
  const Calibration ours = after(recording, {}).estimate(),
                    batch = batch_of(recording, 2, NoiseLaw::f_squared);
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  EXPECT_LT(largest_difference(ours, batch), 0.05);
}

TEST(RecursiveLandmarks, RefusesStatesWhoseKeptStopsAreBroken) {
  const nlohmann::ordered_json state =
      nlohmann::ordered_json::parse(after(drive({100, 1}, 75), RecursiveLandmarksOptions{}).to_json());
  ASSERT_TRUE(state.at("past").is_object());
  const auto refused = [&](const std::function<void(nlohmann::ordered_json&)>& breaks) {
    nlohmann::ordered_json broken = state;
    breaks(broken);
    EXPECT_THROW(RecursiveLandmarks::from_json(broken.dump(), "state"), InputError);
  };
  EXPECT_NO_THROW(RecursiveLandmarks::from_json(state.dump(), "state"));
  refused([](auto& s) { s["past"] = 5; });
  refused([](auto& s) { s["past"] = nlohmann::ordered_json::array(); });
  refused([](auto& s) { s["past"]["stops"][0]["cells"] = 2000000000; });
  refused([](auto& s) { s["past"]["stops"][0]["shape"] = "x"; });
  refused([](auto& s) { s["past"]["radius_m"][0] = -5.0; });
  refused([](auto& s) { s["past"]["cells"]["landmark"].push_back(0); });
  refused([](auto& s) { s["tried_at"] = 2000000000; });
  refused([](auto& s) { s["anew_stops"] = 2000000000; });
  const auto error = [&](const std::function<void(nlohmann::ordered_json&)>& breaks) -> std::string {
    nlohmann::ordered_json broken = state;
    breaks(broken);
    try {
      RecursiveLandmarks::from_json(broken.dump(), "state");
    } catch (const InputError& caught) {
      return caught.what();
    }
    return "none";
  };
  EXPECT_EQ(error([](auto& s) { s["past"].erase("cells"); }), "state: field 'past.cells': is missing");
  EXPECT_EQ(
      error([](auto& s) { s["past"]["stops"][1]["sgima"] = 0; }),
      "state: field 'past.stops[1].sgima': is unknown; known here: pose, sigma, shape, opens_place, cells");
  EXPECT_EQ(error([](auto& s) {
              s["sums"]["hessian"][2][0] = nullptr;
            }).rfind("state: field 'sums.hessian[2]': is not ", 0),
            0u);
  EXPECT_EQ(error([](auto& s) { s["held"][0]["pose"][2] = "north"; }),
            "state: field 'held[0].pose[2]': is not a number");
}

TEST(RecursiveLandmarks, StateIsSavedWholeAndGoesOnBitByBit) {
  Drive shaped;
  shaped.sigma_heading = 0.01;
  shaped.shaped = true;
  std::string state;
  for (const bool walk : {true, false}) {
    shaped.walk = walk;
    const Recording recording = drive(shaped, 70);
    RecursiveLandmarksOptions options = options_for(shaped);
    if (!walk) options.forget = 500.0;
    RecursiveLandmarks whole = after(recording, options);
    for (const std::size_t cut : {std::size_t{7}, std::size_t{203}, std::size_t{1404}}) {
      RecursiveLandmarks first(options);
      for (std::size_t i = 0; i < cut; ++i) first.add(reading_of(recording, i));
      LandmarkReading bad = reading_of(recording, cut);
      bad.range_m = -1.0;
      first.add(bad);
      RecursiveLandmarks second = RecursiveLandmarks::from_json(first.to_json(), "state");
      EXPECT_EQ(second.to_json(), first.to_json());
      EXPECT_EQ(second.last_stop(), first.last_stop());
      EXPECT_EQ(second.counts().dropped.size(), 1u);
      for (std::size_t i = cut; i < recording.readings.size(); ++i) second.add(reading_of(recording, i));
      EXPECT_EQ(second.estimate().alpha, whole.estimate().alpha);
      EXPECT_EQ(second.from_bearings()[2].position_m, whole.from_bearings()[2].position_m);
    }
    state = whole.to_json();
    if (!walk) continue;
    for (const auto& [what, by] :
         {std::pair<std::string, std::string>{"\"anchored\":true", "\"anchored\":false"},
          {"\"free\":[true", "\"free\":[false"},
          {"\"turn\":[[", "\"turn\":[[1,"}}) {
      std::string broken = state;
      ASSERT_NE(broken.find(what), std::string::npos) << what;
      broken.replace(broken.find(what), what.size(), by);
      EXPECT_THROW(RecursiveLandmarks::from_json(broken, "state"), InputError) << what;
    }
  }
  EXPECT_THROW(RecursiveLandmarks::from_json("{}", "state"), InputError);
  EXPECT_THROW(RecursiveLandmarks::from_json("not json", "state"), InputError);
  for (const auto& [what, by] : {std::pair<std::string, std::string>{"landmarks/3", "landmarks/9"},
                                 {"\"half_width\":", "\"half_width\":-"},
                                 {"\"opens_place\":true", "\"opens_place\":7"},
                                 {"\"reference\":[", "\"reference\":[1,"},
                                 {"\"shape\":[", "\"shape\":[-"},
                                 {"\"block\":32", "\"block\":-1"}}) {
    std::string broken = state;
    ASSERT_NE(broken.find(what), std::string::npos) << what;
    broken.replace(broken.find(what), what.size(), by);
    EXPECT_THROW(RecursiveLandmarks::from_json(broken, "state"), InputError) << what;
  }
}

TEST(RecursiveLandmarks, FollowsSigmasThatLeaveWhatWasSummedUp) {
  // One bearing of stop 70 is off by 0.5 rad: sigma_theta goes from 0.0087 to sqrt(0.0087^2 + 0.25 / 600) = 0.022, by a
  // factor of 2.5, further than the sums of the first 64 stops reach (e^0.6 = 1.8). They are made anew.
  Recording recording = drive({120, 1}, 77);
  for (std::size_t i = 0; i < recording.readings.size(); ++i)
    if (recording.readings.stop[i] == 70) {
      recording.readings.bearing_rad[i] += 0.5;
      break;
    }
  RecursiveLandmarksOptions options;
  options.noise_shape = NoiseShape::gaussian;
  RecursiveLandmarks tracked = after(recording, options);
  const RecursiveLandmarks saved = RecursiveLandmarks::from_json(tracked.to_json(), "state");
  EXPECT_EQ(saved.to_json(), tracked.to_json());
  const Calibration ours = tracked.estimate(), batch = batch_of(recording, 2, NoiseLaw::f_squared);
  ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
  EXPECT_EQ(ours.reason, "");
  EXPECT_LT(largest_difference(ours, batch), 0.1);
  EXPECT_EQ(tracked.stops_left_out(), 0);
}

TEST(RecursiveLandmarks, ConvergesWhereCalibrateDoesOnCamerasOfRealRobots) {
  // Their ranges are off alike at a stop, so that the curve of the first 32 stops lies 5 standard deviations off.
  for (const int robot : {1, 2}) {
    const std::filesystem::path folder =
        std::filesystem::path(testing::recordings()) / fmt::format("rangecal/mrclam6-robot{}", robot);
    RANGECAL_REQUIRE_RECORDING(folder);
    const Recording recording = load_recording(folder.string());
    RecursiveLandmarksOptions options;
    options.sigma_xy_m = recording.sigma_xy_m;
    options.sigma_heading_rad = recording.sigma_heading_rad;
    const Calibration shaped = after(recording, options).estimate();  // of another likelihood
    EXPECT_EQ(shaped.outcome, Outcome::converged) << robot << " " << shaped.reason;
    options.noise_shape = NoiseShape::gaussian;
    RecursiveLandmarks tracked = after(recording, options);
    const Calibration ours = tracked.estimate(), batch = batch_of(recording, 2, NoiseLaw::f_squared);
    ASSERT_EQ(ours.outcome, Outcome::converged) << robot << " " << ours.reason;
    EXPECT_LT(largest_difference(ours, batch), 1.0) << robot;
    EXPECT_EQ(ours.counts.used, static_cast<int>(recording.readings.size()));
  }
}

TEST(RecursiveLandmarks, StopsLeftOutAreCountedAsStops) {
  // The same reading for ever: 300 stops of one reading each, blocks of 32, given up at 4 x 32 or up to 8 stops later.
  const Recording recording = drive({20, 1}, 90);
  RecursiveLandmarks stuck;
  LandmarkReading same = reading_of(recording, 0), twice = same;
  for (int i = 0; i < 300; ++i) {
    same.stop.label = twice.stop.label = std::to_string(i);
    stuck.add(same);
    stuck.add(twice);
  }
  const auto dropped = stuck.counts().dropped.find("at stops without an optimum");
  ASSERT_NE(dropped, stuck.counts().dropped.end());
  EXPECT_GE(stuck.stops_left_out(), 128);
  EXPECT_EQ(dropped->second, 2 * stuck.stops_left_out());  // two readings each
}

/// Gross ranges (0.2 to 5 m) and bearings, or ranges late by 0.3 m in the mean, of these shares.
struct Outliers {
  double gross = 0.0, late = 0.0;
};
Recording drive_with(const Drive& d, const Outliers& outliers, std::uint64_t repeat) {
  Recording recording = drive(d, repeat);
  Random random(seed_from("recursive landmarks outliers", {repeat}));
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    double& range = recording.readings.range_m[i];
    if (random.uniform(0.0, 1.0) < outliers.gross) range = random.uniform(0.2, 5.0);
    if (random.uniform(0.0, 1.0) < outliers.gross)
      recording.readings.bearing_rad[i] = random.uniform(-3.1, 3.1);
    if (random.uniform(0.0, 1.0) < outliers.late) range -= 0.3 * std::log(random.uniform(1e-9, 1.0));
  }
  return recording;
}

TEST(RecursiveLandmarks, IsTheBatchAnswerUnderOutliers) {
  // Landmarks and curve: RMSE over that of `marginal` with shapes on the whole recording; 350 stops are more than are kept
  // as they came.
  for (const Outliers& outliers : {Outliers{0.002, 0.0}, {0.01, 0.0}, {0.05, 0.0}, {0.0, 0.05}}) {
    double ours_sq = 0.0, batch_sq = 0.0, ours_curve = 0.0, batch_curve = 0.0;
    for (std::uint64_t repeat = 0; repeat < 2; ++repeat) {
      const Drive d{350, 1};
      const Recording recording = drive_with(d, outliers, repeat);
      const Calibration ours = after(recording, options_for(d)).estimate();
      CalibrateOptions options;
      options.methods = {Method::marginal};
      options.order = 2;
      options.noise = d.law;
      const Calibration batch = calibrate({&recording, 1}, options)[0];
      ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason << outliers.gross;
      ASSERT_EQ(batch.outcome, Outcome::converged) << batch.reason;
      EXPECT_FALSE(ours.noise_shapes.empty());
      EXPECT_NEAR(ours.outlier_count, batch.outlier_count, 0.1 * batch.outlier_count + 2.0);
      const JointState truth = testing::truth_of(recording);
      for (std::size_t l = 0; l < ours.landmarks.size(); ++l) {
        ours_sq += (ours.landmarks[l].position_m - truth.landmarks[l]).squaredNorm();
        batch_sq += (batch.landmarks[l].position_m - truth.landmarks[l]).squaredNorm();
      }
      for (double at = 0.7; at < 4.0; at += 0.3) {
        const double f = evaluate_polynomial(truth.alpha, at);
        ours_curve += std::pow(evaluate_polynomial(ours.alpha, at) - f, 2);
        batch_curve += std::pow(evaluate_polynomial(batch.alpha, at) - f, 2);
      }
    }
    EXPECT_LT(std::sqrt(ours_sq / batch_sq), 1.1) << outliers.gross << ' ' << outliers.late;
    EXPECT_LT(std::sqrt(ours_curve / batch_curve), 1.2) << outliers.gross << ' ' << outliers.late;
  }
}

TEST(RecursiveLandmarks, IntervalsHoldUnderOutliers) {
  // Landmarks of 30 streams, one-sided outliers of 5 %, without and with forgetting and along a random walk: z^2 / 10 of all
  // ten coordinates has mean 1; their correlation leaves some 20 worth: +- 4 sqrt(2 / 30 / 3) = 0.60 at most.
  constexpr double never = std::numeric_limits<double>::infinity();
  for (const auto& [forget, walk] : {std::pair{never, false}, {60.0, false}, {never, true}}) {
    Drive d{80, 1};
    d.walk = walk;
    RecursiveLandmarksOptions options = options_for(d);
    options.forget = forget;
    double squares = 0.0;
    constexpr int streams = 30;
    for (std::uint64_t repeat = 0; repeat < streams; ++repeat) {
      const Recording recording = drive_with(d, {0.0, 0.05}, 2000 + repeat);
      const Calibration fit = after(recording, options).estimate();
      ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason << repeat;
      const JointState truth = testing::truth_of(recording);
      for (std::size_t l = 0; l < fit.landmarks.size(); ++l) {
        const Eigen::Vector2d error = fit.landmarks[l].position_m - truth.landmarks[l];
        squares += error.dot(fit.landmarks[l].covariance->inverse() * error) / 10.0;
      }
    }
    EXPECT_NEAR(squares / streams, 1.0, 0.60) << forget << walk;
  }
}

TEST(RecursiveLandmarks, StateWithOutliersGoesOnBitByBit) {
  const Drive d{150, 2};
  const Recording recording = drive_with(d, {0.01, 0.03}, 7);
  RecursiveLandmarks whole(options_for(d)), first(options_for(d));
  const std::size_t half = recording.readings.size() / 2;
  for (std::size_t i = 0; i < half; ++i) first.add(reading_of(recording, i));
  RecursiveLandmarks second = RecursiveLandmarks::from_json(first.to_json(), "state");
  EXPECT_EQ(second.to_json(), first.to_json());
  for (std::size_t i = 0; i < recording.readings.size(); ++i) whole.add(reading_of(recording, i));
  for (std::size_t i = half; i < recording.readings.size(); ++i) second.add(reading_of(recording, i));
  EXPECT_EQ(second.to_json(), whole.to_json());
  EXPECT_EQ(second.estimate().alpha, whole.estimate().alpha);
}

TEST(RecursiveLandmarks, TellsOutliersBeforeItTakesThem) {
  const Drive d{150, 1};
  const Recording recording = drive_with(d, {0.02, 0.0}, 5), clean = drive(d, 5);
  RecursiveLandmarks tracked(options_for(d));
  int gross = 0, told = 0, good = 0, wrong = 0;
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const auto outlier = tracked.outlier_probability(reading_of(recording, i));
    const double off = std::abs(recording.readings.range_m[i] - clean.readings.range_m[i]),
                 turned = std::abs(recording.readings.bearing_rad[i] - clean.readings.bearing_rad[i]);
    if (outlier && (off > 0.5 || turned > 0.2)) {
      ++gross;
      told += *outlier > 0.99;
    } else if (outlier && off == 0.0 && turned == 0.0) {
      ++good;
      wrong += *outlier > 0.5;
    }
    tracked.add(reading_of(recording, i));
  }
  EXPECT_GT(gross, 8);
  EXPECT_GE(told, 0.85 * gross);  // some lie near what is predicted
  EXPECT_GT(good, 400);
  EXPECT_LT(wrong, 0.02 * good);
}

TEST(RecursiveLandmarks, MemoryDoesNotGrowAtAStop) {
  // A robot that stands still: readings that are alike are put together.
  const Recording one = drive({1, 1});
  RecursiveLandmarks tracked(options_for({}));
  Random random(seed_from("stands still"));
  std::size_t before = 0;
  for (int i = 0; i < 40000; ++i) {
    LandmarkReading reading = reading_of(one, static_cast<std::size_t>(i % 5));
    reading.range_m += random.normal(0.0, 0.02);
    reading.bearing_rad += random.normal(0.0, 0.0087);
    if (i % 100 == 0) reading.range_m += random.uniform(0.0, 3.0);
    tracked.add(reading);
    if (i == 9999) before = tracked.to_json().size();
  }
  EXPECT_EQ(tracked.used(), 40000);
  EXPECT_LT(tracked.to_json().size(), 1.4 * static_cast<double>(before));
}

TEST(RecursiveLandmarks, MemoryDoesNotGrow) {
  Drive d{400, 1};
  for (const bool walk : {false, true}) {
    d.walk = walk;
    d.sigma_heading = walk ? 0.005 : 0.0;
    const Recording recording = drive(d, 80);
    RecursiveLandmarks tracked(options_for(d));
    std::size_t at_300 = 0;  // stops: those before 256 are kept as they came
    for (std::size_t i = 0; i < recording.readings.size(); ++i) {
      tracked.add(reading_of(recording, i));
      if (i == 5 * 300 - 1) at_300 = tracked.to_json().size();
    }
    EXPECT_LT(static_cast<double>(tracked.to_json().size()),
              1.1 * static_cast<double>(at_300));  // digits of the numbers
  }
}

TEST(RecursiveLandmarks, HostileInput) {
  const Recording recording = drive({20, 1}, 90);
  RecursiveLandmarks tracked;
  EXPECT_EQ(tracked.estimate().outcome, Outcome::too_few_data);
  LandmarkReading reading = reading_of(recording, 0);
  for (const double bad : {std::nan(""), 0.0, -1.0, std::numeric_limits<double>::infinity()}) {
    reading.range_m = bad;
    EXPECT_FALSE(tracked.add(reading));
  }
  reading = reading_of(recording, 0);
  reading.bearing_rad = std::nan("");
  EXPECT_FALSE(tracked.add(reading));
  EXPECT_EQ(tracked.counts().read, 5);
  EXPECT_EQ(tracked.used(), 0);
  reading = reading_of(recording, 0);
  reading.stop.commanded.x_m = std::nan("");
  EXPECT_THROW(tracked.add(reading), InputError);
  reading = reading_of(recording, 0);
  reading.radius_m = -1.0;
  EXPECT_THROW(tracked.add(reading), InputError);
  reading.radius_m = 0.1;
  reading.stop.sigma_xy_m = -0.1;
  EXPECT_THROW(tracked.add(reading), InputError);
  for (std::size_t i = 0; i < 10; ++i) tracked.add(reading_of(recording, i));  // two stops
  EXPECT_EQ(tracked.estimate().outcome, Outcome::too_few_data);
  EXPECT_THROW(tracked.add(reading_of(recording, 0)), InputError);  // the first comes back
  // the same reading for ever: nothing is determined, nothing fails
  RecursiveLandmarks stuck;
  LandmarkReading same = reading_of(recording, 0);
  for (int i = 0; i < 300; ++i) {
    same.stop.label = std::to_string(i);
    stuck.add(same);
  }
  EXPECT_NE(stuck.estimate().outcome, Outcome::converged);
  // a walk of steps that are exact in length but not in heading: positions could not follow the turns
  RecursiveLandmarksOptions turning;
  turning.random_walk = true;
  turning.sigma_xy_m = 0.0;
  turning.sigma_heading_rad = 0.01;
  RecursiveLandmarks turned(turning);
  EXPECT_TRUE(turned.add(reading_of(recording, 0)));
  EXPECT_THROW(turned.add(reading_of(recording, 5)), InputError);
  EXPECT_EQ(turned.stops(), 1);
  RecursiveLandmarksOptions bad;
  bad.law = NoiseLaw::polynomial;
  EXPECT_THROW(RecursiveLandmarks{bad}, InputError);
  bad = {};
  bad.block = 0;
  EXPECT_THROW(RecursiveLandmarks{bad}, InputError);
  bad = {};
  bad.forget = 0.0;
  EXPECT_THROW(RecursiveLandmarks{bad}, InputError);
  bad.forget = 100.0;
  bad.random_walk = true;
  EXPECT_THROW(RecursiveLandmarks{bad}, InputError);
}

}  // namespace
}  // namespace rangecal
