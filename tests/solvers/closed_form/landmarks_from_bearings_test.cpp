// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmarks_from_bearings.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "solvers/closed_form/scenes.hpp"

namespace rangecal {
namespace {

using closed_form_tests::BearingScene;
using closed_form_tests::problem_of;

constexpr BearingWeights all_weights[] = {BearingWeights::paper, BearingWeights::printed,
                                          BearingWeights::consistent};

TEST(LandmarksFromBearings, ExactOnNoiseFreeData) {
  BearingScene scene;
  const JointProblem problem = problem_of(scene);
  for (const BearingWeights weights : all_weights) {
    BearingOptions options;
    options.weights = weights;
    const LandmarksFromBearings found = landmarks_from_bearings(problem, options);
    ASSERT_EQ(found.outcome, Outcome::converged) << found.reason;
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l)
      EXPECT_LT((found.landmarks[l].position_m - scene.landmarks[l]).norm(), 1e-10) << to_string(weights);
  }
}

TEST(LandmarksFromBearings, HandWorkedIntersection) {
  // stops (0,0) and (2,0), heading pi/2 each, bearings -pi/4 and +pi/4: lines at 45 and 135 degrees meet in
  // (1, 1). consistent weights, sigma_s = 0.1, sigma_theta = 0: both lines have variance 0.01, H^T H = I
  // (perpendicular unit normals), so the covariance is 0.01 I
  JointProblem problem = problem_of(BearingScene{.landmarks = {{1.0, 1.0}}, .stops = 2, .radius = 0.0});
  for (int k = 0; k < 2; ++k) {
    problem.stops[k].commanded = {2.0 * k, 0.0, std::numbers::pi / 2};
    problem.cells.bearing_mean[k] = (2 * k - 1) * std::numbers::pi / 4;
  }
  BearingOptions options;
  options.sigma_s_m = 0.1;
  options.sigma_theta_rad = 0.0;
  const LandmarkFromBearings found = landmarks_from_bearings(problem, options).landmarks.at(0);
  ASSERT_EQ(found.outcome, Outcome::converged) << found.reason;
  EXPECT_LT((found.position_m - Eigen::Vector2d(1.0, 1.0)).norm(), 1e-12);
  EXPECT_LT((found.covariance - 0.01 * Eigen::Matrix2d::Identity()).norm(), 1e-12);
  EXPECT_NEAR(found.condition, 1.0, 1e-9);
}

TEST(LandmarksFromBearings, LandmarkInLineWithThePathIsUnobservableAlongIt) {
  for (const double sigma_theta : {0.0, 0.01}) {
    BearingScene scene{.landmarks = {{7.0, 0.0}, {2.0, 2.0}}, .sigma_theta = sigma_theta, .straight = true};
    const LandmarksFromBearings found = landmarks_from_bearings(problem_of(scene));
    EXPECT_EQ(found.outcome, Outcome::unobservable);
    EXPECT_EQ(found.landmarks[0].outcome, Outcome::unobservable);
    EXPECT_NEAR(std::abs(found.landmarks[0].weakest_direction.x()), 1.0, 1e-3);
    EXPECT_NE(found.reason.find("landmark 0"), std::string::npos);
    EXPECT_EQ(found.landmarks[1].outcome, Outcome::converged);
  }
}

TEST(LandmarksFromBearings, LinesThatDoNotMeetAreNotCalledParallel) {
  // Headings off by -0.9, 0, 0.9 rad in turn: the directions spread by some 38 degrees, and sigma_theta, estimated from what
  // the lines miss each other by, comes out at 68.
  JointProblem problem = problem_of(BearingScene{.sigma_theta = 0.005});
  for (int k = 0; k < problem.stop_count(); ++k) problem.stops[k].commanded.heading_rad += 0.9 * (k % 3 - 1);
  const LandmarksFromBearings found = landmarks_from_bearings(problem);
  EXPECT_EQ(found.outcome, Outcome::unobservable);
  for (const LandmarkFromBearings& landmark : found.landmarks) {
    EXPECT_NE(landmark.reason.find("do not meet"), std::string::npos) << landmark.reason;
    EXPECT_NE(landmark.reason.find("not determined along"), std::string::npos) << landmark.reason;
  }
}

TEST(LandmarksFromBearings, OneStopIsUnobservable) {
  const LandmarksFromBearings found = landmarks_from_bearings(problem_of(BearingScene{.stops = 1}));
  EXPECT_EQ(found.outcome, Outcome::unobservable);
  EXPECT_NE(found.landmarks[0].reason.find("one stop"), std::string::npos);
}

TEST(LandmarksFromBearings, SigmaThetaIsRecovered) {
  double mean = 0.0;
  for (std::uint64_t repeat = 0; repeat < 100; ++repeat) {
    BearingScene scene{.sigma_theta = 0.02, .sigma_s = 0.01, .sigma_e = 0.005};
    mean +=
        landmarks_from_bearings(problem_of(scene, seed_from("SigmaTheta", {repeat}))).sigma_theta_rad / 100;
  }
  EXPECT_NEAR(mean, 0.02, 0.0006);  // one fit: 6 %; the mean of 100: 0.6 %, and 2 % for curvature
}

TEST(LandmarksFromBearings, CovariancePredictsTheScatter) {
  const int repeats = 300;
  double square = 0.0;
  for (std::uint64_t repeat = 0; repeat < repeats; ++repeat) {
    BearingScene scene{.stops = 20, .sigma_theta = 0.008, .sigma_s = 0.01, .sigma_e = 0.005};
    BearingOptions options;
    options.sigma_theta_rad = 0.008;
    const auto found = landmarks_from_bearings(problem_of(scene, seed_from("Scatter", {repeat})), options);
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
      const Eigen::Vector2d e = found.landmarks[l].position_m - scene.landmarks[l];
      square += e.dot(found.landmarks[l].covariance.inverse() * e) / (2.0 * 5 * repeats);
    }
  }
  EXPECT_NEAR(square, 1.0,
              0.15);  // chi-square: 2.6 % per standard deviation, stops shared among landmarks; bias
}

TEST(LandmarksFromBearings, ConsistentWeightsAreTheMostAccurate) {
  // docs/equations.md quotes these: sigma_theta 0.5 deg, sigma_s 5 cm, 400 random scenes
  double square[3] = {0.0, 0.0, 0.0};
  for (std::uint64_t number = 0; number < 400; ++number) {
    Random random(seed_from("Weights.Scenes", {number}));
    BearingScene scene{.sigma_theta = 0.0087, .sigma_s = 0.05, .sigma_e = 0.01};
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l)
      scene.landmarks[l] = {random.uniform(0.0, 4.5), (l % 2 ? 1.0 : -1.0) * random.uniform(0.8, 3.0)};
    const JointProblem problem = problem_of(scene, number);
    for (int w = 0; w < 3; ++w) {
      BearingOptions options;
      options.weights = all_weights[w];
      const auto found = landmarks_from_bearings(problem, options);
      for (std::size_t l = 0; l < scene.landmarks.size(); ++l)
        square[w] += (found.landmarks[l].position_m - scene.landmarks[l]).squaredNorm() / 2000.0;
    }
  }
  EXPECT_NEAR(std::sqrt(square[0]), 0.043, 0.003);  // paper
  EXPECT_NEAR(std::sqrt(square[1]), 0.041, 0.003);  // printed
  EXPECT_NEAR(std::sqrt(square[2]), 0.033, 0.002);  // consistent
}

TEST(LandmarksFromBearings, RawPositionsStandWhereLinesAreParallel) {
  BearingScene scene{.landmarks = {{7.0, 0.0}}, .straight = true};
  scene.alpha = Eigen::VectorXd{{0.0, 1.0}};
  const auto positions = landmarks_from_positions(problem_of(scene));
  ASSERT_TRUE(positions.at(0));
  EXPECT_LT((*positions[0] - Eigen::Vector2d(7.0, 0.0)).norm(), 1e-12);
}

TEST(LandmarksFromBearings, WeightsByName) {
  for (const BearingWeights weights : all_weights)
    EXPECT_EQ(bearing_weights_from_string(to_string(weights)), weights);
  EXPECT_THROW(bearing_weights_from_string("best"), InputError);
}

}  // namespace
}  // namespace rangecal
