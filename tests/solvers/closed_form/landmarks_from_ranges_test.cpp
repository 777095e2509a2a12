// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmarks_from_ranges.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "solvers/closed_form/scenes.hpp"

namespace rangecal {
namespace {

using closed_form_tests::BearingScene;
using Eigen::Vector2d;

/// Ranges alone of a scene of landmarks.
Recording ranges_of(const BearingScene& scene, std::uint64_t seed) {
  Recording recording = closed_form_tests::record(scene, seed);
  recording.readings.bearing_rad.clear();
  return recording;
}

JointProblem problem_of(const Recording& recording) {
  return make_joint_problem(std::vector<Recording>{recording});
}

/// A sensor without bias, its noise 1 cm at 1 m.
BearingScene true_ranges() {
  BearingScene scene;
  scene.alpha = Eigen::Vector2d(0.0, 1.0);
  return scene;
}

TEST(LandmarksFromRanges, ExactOnNoiseFreeRanges) {
  const BearingScene scene = true_ranges();
  const LandmarksFromRanges found = landmarks_from_ranges(problem_of(ranges_of(scene, 1)));
  ASSERT_EQ(found.outcome, Outcome::converged) << found.reason;
  for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
    EXPECT_LT((found.landmarks[l].position_m - scene.landmarks[l]).norm(), 1e-8) << l;
    EXPECT_FALSE(found.landmarks[l].mirror_m);
  }
}

TEST(LandmarksFromRanges, HandWorkedMirrorOfAPathAlongALine) {
  // stops (0,0), (2,0), (4,0) and a landmark of radius 0.1 at (1,2): axis distances sqrt 5, sqrt 5, sqrt 13; (1,-2) fits as well
  BearingScene scene = true_ranges();
  scene.landmarks = {{1.0, 2.0}};
  scene.stops = 3;
  scene.radius = 0.1;
  scene.straight = true;
  Recording recording = ranges_of(scene, 1);
  for (int k = 0; k < 3; ++k) {
    recording.stops[static_cast<std::size_t>(k)].commanded = {2.0 * k, 0.0, 0.0};
    recording.readings.range_m[static_cast<std::size_t>(k)] = std::sqrt(k == 2 ? 13.0 : 5.0) - 0.1;
  }
  const LandmarksFromRanges found = landmarks_from_ranges(problem_of(recording));
  ASSERT_EQ(found.outcome, Outcome::converged) << found.reason;
  const LandmarkFromRanges& landmark = found.landmarks.at(0);
  EXPECT_NEAR(landmark.position_m.x(), 1.0, 1e-8);
  EXPECT_NEAR(std::abs(landmark.position_m.y()), 2.0, 1e-8);
  ASSERT_TRUE(landmark.mirror_m);
  EXPECT_NEAR(landmark.mirror_m->x(), 1.0, 1e-8);
  EXPECT_NEAR(landmark.mirror_m->y(), -landmark.position_m.y(), 1e-8);
  EXPECT_NE(found.reason.find("mirror"), std::string::npos) << found.reason;
}

TEST(LandmarksFromRanges, TwoPlacesLeaveTwoPoints) {
  BearingScene scene = true_ranges();
  scene.stops = 2;
  scene.repeats = 5;
  const LandmarksFromRanges found = landmarks_from_ranges(problem_of(ranges_of(scene, 1)));
  EXPECT_EQ(found.outcome, Outcome::too_few_data);
  EXPECT_EQ(found.landmarks.at(0).outcome, Outcome::unobservable);
  EXPECT_NE(found.landmarks.at(0).reason.find("2 place"), std::string::npos);
}

TEST(LandmarksFromRanges, ALateEchoHasNoInfluence) {
  BearingScene scene = true_ranges();
  scene.sigma_e = 0.002;
  Recording recording = ranges_of(scene, 3);
  const LandmarksFromRanges clean = landmarks_from_ranges(problem_of(recording));
  recording.readings.range_m[7] += 6.0;
  const LandmarksFromRanges found = landmarks_from_ranges(problem_of(recording));
  for (std::size_t l = 0; l < scene.landmarks.size(); ++l)
    EXPECT_LT((found.landmarks[l].position_m - clean.landmarks[l].position_m).norm(), 0.01) << l;
}

TEST(LandmarksFromRanges, CovarianceIsThatOfTheDraws) {
  BearingScene scene = true_ranges();
  scene.landmarks = {{1.0, 2.0}, {3.5, -1.5}};
  scene.alpha = Eigen::Vector2d(0.0, 1.0);
  scene.stops = 40;
  constexpr int draws = 400;
  for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
    Eigen::Matrix2d of_draws = Eigen::Matrix2d::Zero(), stated = of_draws;
    for (int draw = 0; draw < draws; ++draw) {
      Recording recording = ranges_of(scene, 1);
      Random random(seed_from("covariance from ranges", {static_cast<std::uint64_t>(draw)}));
      for (double& range : recording.readings.range_m) range += 0.03 * random.normal();
      const LandmarkFromRanges found = landmarks_from_ranges(problem_of(recording)).landmarks[l];
      const Vector2d off = found.position_m - scene.landmarks[l];
      of_draws += off * off.transpose() / draws;
      stated += found.covariance / draws;
    }
    // of 400 squares the mean spreads by sqrt(2 / 400) = 0.07 of itself; a sandwich of 40 residuals is too small by some per cent
    const Eigen::Matrix2d ratio = stated.inverse() * of_draws;
    EXPECT_NEAR(0.5 * ratio.trace(), 1.0, 0.2) << l;
  }
}

/// The joint NLL of ranges and stops, term by term.
double nll_by_hand(const Recording& recording, const JointState& state) {
  double nll = 0.0;
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const auto stop = static_cast<std::size_t>(recording.readings.stop[i]),
               landmark = static_cast<std::size_t>(recording.readings.landmark[i]);
    const Vector2d v = state.landmarks[landmark] - Vector2d(state.stops[stop].x_m, state.stops[stop].y_m);
    const double d = v.norm() - recording.landmarks[landmark].radius_m,
                 f = evaluate_polynomial(state.alpha, d), s = state.noise.spread(d, f),
                 e = (recording.readings.range_m[i] - f) / s;
    nll += 0.5 * e * e + std::log(s) + half_log_two_pi;
  }
  for (std::size_t k = 0; k < recording.stops.size(); ++k) {
    const double dx = state.stops[k].x_m - recording.stops[k].commanded.x_m,
                 dy = state.stops[k].y_m - recording.stops[k].commanded.y_m, s = recording.sigma_xy_m;
    nll += 0.5 * (dx * dx + dy * dy) / (s * s) + 2.0 * (std::log(s) + half_log_two_pi);
  }
  return nll;
}

/// A drive with cylinders on both sides, ranges alone.
BearingScene drive() {
  BearingScene scene;
  scene.sigma_s = 0.01;
  scene.sigma_e = 0.005;
  scene.repeats = 5;
  return scene;
}

TEST(RangesAlone, TheLikelihoodIsThatOfRangesAndStops) {
  const Recording recording = ranges_of(drive(), 5);
  const JointProblem problem = problem_of(recording);
  EXPECT_FALSE(problem.reads_bearings);
  ClosedFormOptions options;
  options.order = 2;
  JointState state = closed_form_state(problem, options);
  EXPECT_EQ(state.sigma_theta_rad, 1.0);
  EXPECT_NEAR(joint_nll(problem, state), nll_by_hand(recording, state),
              1e-9 * std::abs(joint_nll(problem, state)));
  const MarginalFit fit = solve_marginal(problem, state);
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_NEAR(fit.joint_nll, nll_by_hand(recording, fit.state), 1e-9 * std::abs(fit.joint_nll));
  EXPECT_NEAR(fit.state.sigma_theta_rad, 1.0, 1e-9);
  state = fit.state;
  for (Vector2d& landmark : state.landmarks)
    landmark = -landmark;  // where no bearing that was read would have it
  for (Pose2& stop : state.stops) stop.x_m = -stop.x_m, stop.y_m = -stop.y_m;
  Recording turned = recording;
  for (Stop& stop : turned.stops)
    stop.commanded.x_m = -stop.commanded.x_m, stop.commanded.y_m = -stop.commanded.y_m;
  EXPECT_NEAR(joint_nll(problem_of(turned), state), fit.joint_nll, 1e-6);
}

TEST(RangesAlone, EveryMethodFindsTheCurve) {
  const BearingScene scene = drive();
  const std::vector<Recording> recordings{ranges_of(scene, 11)};
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  const std::vector<Calibration> calibrations = calibrate(recordings, options);
  ASSERT_EQ(calibrations.size(), 4u);
  for (const Calibration& calibration : calibrations) {
    const char* method = to_string(calibration.method);
    const bool may_go_on = calibration.method == Method::approximate;  // its sweeps converge linearly
    EXPECT_TRUE(is_usable(calibration.outcome) || may_go_on) << method << ": " << calibration.reason;
    EXPECT_FALSE(calibration.sigma_theta_rad) << method;
    ASSERT_EQ(calibration.alpha.size(), 3) << method;
    if (calibration.method == Method::closed_form)
      continue;  // takes raw ranges for true where it places landmarks
    for (const double d : {1.0, 2.0, 3.0})
      EXPECT_NEAR(calibration.f(d), evaluate_polynomial(scene.alpha, d), 0.06) << method << " at " << d;
  }
}

TEST(RangesAlone, MarginalIntervalsHoldTheCurve) {
  constexpr int worlds = 100;
  const BearingScene scene = drive();
  double sum_sq = 0.0;
  int counted = 0;
  for (int world = 0; world < worlds; ++world) {
    const JointProblem problem =
        problem_of(ranges_of(scene, seed_from("ranges alone", {static_cast<std::uint64_t>(world)})));
    ClosedFormOptions options;
    options.order = 2;
    const MarginalFit fit = solve_marginal(problem, closed_form_state(problem, options));
    if (fit.outcome != Outcome::converged || !fit.covariance) continue;
    const Eigen::Vector3d powers(1.0, 2.0, 4.0);
    const double off = powers.dot(fit.state.alpha - scene.alpha),
                 variance = powers.dot(fit.covariance->topLeftCorner(3, 3) * powers);
    sum_sq += off * off / variance;
    ++counted;
  }
  EXPECT_GE(counted, 95);
  // of 100 squares of standard normals the mean lies within 1 +- 3 sqrt(2 / 100)
  EXPECT_NEAR(sum_sq / counted, 1.0, 0.43);
}

TEST(RangesAlone, OutliersAreTakenForWhatTheyAre) {
  const BearingScene scene = drive();
  Recording recording = ranges_of(scene, 17);
  Random random(seed_from("outliers of ranges alone", {1}));
  int late = 0;
  for (double& range : recording.readings.range_m)
    if (random.uniform(0.0, 1.0) < 0.04) range += random.uniform(0.3, 1.5), ++late;
  const std::vector<Recording> recordings{recording};
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.noise_shape = NoiseShape::automatic;
  const Calibration calibration = calibrate(recordings, options).at(0);
  ASSERT_TRUE(is_usable(calibration.outcome)) << calibration.reason;
  for (const double d : {1.0, 2.0, 3.0})
    EXPECT_NEAR(calibration.f(d), evaluate_polynomial(scene.alpha, d), 0.06) << d;
  EXPECT_GT(calibration.outlier_count, late / 2);
}

TEST(RangesAlone, AreNotMixedWithBearings) {
  std::vector<Recording> recordings{closed_form_tests::record(drive(), 1), ranges_of(drive(), 2)};
  recordings[1].path = "second";
  try {
    make_joint_problem(recordings);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_EQ(std::string(error.what()),
              "second: has no bearings, and the recordings before it have them; calibrate them apart");
  }
}

}  // namespace
}  // namespace rangecal
