// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/joint_nll.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
const double half_log_two_pi = 0.5 * std::log(2.0 * std::numbers::pi);

/// Two stops, each of which sees one of two landmarks; no two numbers are alike that could be taken for each
/// other.
struct JointNllTest : ::testing::Test {
  JointNllTest() {
    problem.stops.resize(2);
    problem.stops[0].commanded = {1.0, 2.0, 0.0};
    problem.stops[1].commanded = {2.0, 1.0, 0.5};
    problem.stops[0].sigma_xy_m = problem.stops[1].sigma_xy_m = 0.1;
    problem.stops[1].place = 1;
    problem.place_count = 2;
    problem.sigma_s_shared = {0, 0};
    problem.landmark_radius_m = {0.25, 0.5};
    Cells& c = problem.cells;
    c.stop = {0, 1};
    c.landmark = {1, 0};
    c.count = {4.0, 2.0};
    c.range_weight = {4.0, 1.5};
    c.bearing_weight = {3.0, 2.0};
    c.range_mean = {4.8, 3.0};
    c.range_mean_square = {0.02, 0.0};
    c.bearing_mean = {1.2, 2.5};
    c.bearing_mean_square = {0.001, 0.0};
    c.radius_m = {0.5, 0.25};
    c.stop_begin = {0, 1, 2};
    state.alpha = Eigen::Vector2d(0.2, 1.0);
    state.noise.law = NoiseLaw::f;
    state.noise.parameters = Eigen::VectorXd::Constant(1, 0.1);
    state.sigma_theta_rad = 0.05;
    state.stops = {{1.0, 2.0, 0.0}, {2.0, 1.0, 0.5}};
    state.landmarks = {{5.0, 3.0}, {4.0, 6.0}};
  }
  JointProblem problem;
  JointState state;
};

TEST_F(JointNllTest, HandWorkedReadings) {
  // Stop 0: sight (3, 4), d = 5 - 0.5 = 4.5, f = 4.7, s = 0.47, e = 0.1: 4 (log s + c) + 2 (0.01 + 0.02) /
  // s^2. Stop 1: sight (3, 2), d = sqrt 13 - 0.25, f = sqrt 13 - 0.05, weight 1.5, e = 3 - f = 3.05 -
  // sqrt 13.
  const double f = std::sqrt(13.0) - 0.05, e = 3.05 - std::sqrt(13.0);
  const double range = 4.0 * (std::log(0.47) + half_log_two_pi) + 2.0 * 0.03 / (0.47 * 0.47) +
                       2.0 * (std::log(0.1 * f) + half_log_two_pi) + 0.75 * e * e / (0.01 * f * f);
  EXPECT_NEAR(joint_nll_parts(problem, state).range, range, 1e-12);
  // Stop 0: theta = atan2(4, 3) = 0.9273, 1.2 - theta; stop 1: theta = atan2(2, 3) - 0.5, 2.5 - theta.
  const double a = 1.2 - std::atan2(4.0, 3.0), b = 2.5 - (std::atan2(2.0, 3.0) - 0.5);
  const double bearing =
      6.0 * (std::log(0.05) + half_log_two_pi) + 1.5 * (a * a + 0.001) / 0.0025 + b * b / 0.0025;
  EXPECT_NEAR(joint_nll_parts(problem, state).bearing, bearing, 1e-9);
  problem.cells.bearing_mean[0] +=
      4.0 * std::numbers::pi;  // a mean that was unwrapped about its first reading
  EXPECT_NEAR(joint_nll_parts(problem, state).bearing, bearing, 1e-9);
  // An effect of slope 0.3 about 4 m: 0.3 (4.5 - 4) = 0.15 less in stop 0's error, -0.05 in place of 0.1.
  problem.cells.effect_slope = {0.3, 0.0};
  problem.cells.effect_slope_at_m = {4.0, 0.0};
  EXPECT_NEAR(joint_nll_parts(problem, state).range, range + 2.0 * (0.0025 - 0.01) / (0.47 * 0.47), 1e-12);
}

TEST_F(JointNllTest, HandWorkedPriors) {
  const double per_place = 2.0 * (std::log(0.1) + half_log_two_pi);
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, 2.0 * per_place, 1e-12);
  // Stop 1 is off by (0.03, -0.04): (0.0009 + 0.0016) / (2 0.01) = 0.125.
  state.stops[1] = {2.03, 0.96, 0.5};
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, 2.0 * per_place + 0.125, 1e-12);
  // Its heading by 0.06 of sigma 0.02, a turn of 2 pi beside it: 0.06^2 / (2 0.02^2) = 4.5.
  problem.stops[1].sigma_heading_rad = 0.02;
  state.stops[1].heading_rad = 0.56 + 2.0 * std::numbers::pi;
  const double headings = 4.5 + std::log(0.02) + half_log_two_pi;
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, 2.0 * per_place + 0.125 + headings, 1e-9);
  // A second stop at the same place has no position prior of its own, an exact one none at all.
  problem.stops[1].opens_place = false;
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, per_place + headings, 1e-9);
  problem.stops[1].opens_place = true;
  problem.stops[1].sigma_xy_m = 0.0;
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, per_place + headings, 1e-9);
}

TEST_F(JointNllTest, HandWorkedRandomWalk) {
  // Commanded is a step of (1, -1) in stop 0's frame. Found is (1.2, 1.1) from a stop 0 that turned by a
  // quarter, in its frame (1.1, -1.2). Error (0.1, -0.2): (0.01 + 0.04) / (2 0.01) = 2.5.
  const double right_angle = 0.5 * std::numbers::pi;
  problem.stops[1].chained = true;
  problem.stops[1].sigma_heading_rad = 0.1;
  state.stops[0] = {3.0, -1.0, right_angle};
  state.stops[1] = {4.2, 0.1, right_angle + 0.8};
  // Turn: 0.8 where 0.5 was commanded, 0.3 of sigma 0.1: 4.5. Stop 0's own error (2, -3): 13 / (2 0.01) =
  // 650.
  const double constants = 4.0 * (std::log(0.1) + half_log_two_pi) + std::log(0.1) + half_log_two_pi;
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, constants + 650.0 + 2.5 + 4.5, 1e-9);
  // The same where the commanded headings start at 0.4: the step turned back is (cos 0.4 - sin 0.4, -sin 0.4
  // - cos 0.4).
  problem.stops[0].commanded.heading_rad = 0.4;
  problem.stops[1].commanded.heading_rad = 0.9;
  const double x = 1.1 - std::cos(0.4) + std::sin(0.4), y = -1.2 + std::sin(0.4) + std::cos(0.4);
  EXPECT_NEAR(joint_nll_parts(problem, state).stops, constants + 650.0 + 50.0 * (x * x + y * y) + 4.5, 1e-9);
}

TEST_F(JointNllTest, HandWorkedTape) {
  // (5, 3) to (4, 6): sqrt(1 + 9) = 3.1622776601683795, 0.0622776601683795 more than the tape's 3.1 of sigma
  // 0.02.
  problem.known_distances = {{.from = 0, .to = 1, .distance_m = 3.1, .sigma_m = 0.02}};
  const double z = 3.113883008418975;
  EXPECT_NEAR(joint_nll_parts(problem, state).taped, 0.5 * z * z + std::log(0.02) + half_log_two_pi, 1e-9);
  const JointNllParts parts = joint_nll_parts(problem, state);
  EXPECT_EQ(joint_nll(problem, state), parts.range + parts.bearing + parts.stops + parts.taped);
}

TEST_F(JointNllTest, InfiniteOutsideOfTheDomain) {
  EXPECT_TRUE(std::isfinite(joint_nll(problem, state)));
  JointState other = state;
  other.sigma_theta_rad = 0.0;
  EXPECT_EQ(joint_nll(problem, other), infinity);
  other = state;
  other.noise.parameters[0] = 0.0;
  EXPECT_EQ(joint_nll(problem, other), infinity);
  other = state;
  other.stops[0] = {4.3, 6.0, 0.0};  // within the landmark's radius
  EXPECT_EQ(joint_nll(problem, other), infinity);
  other = state;
  other.stops[0].heading_rad = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(joint_nll(problem, other), infinity);
}

}  // namespace
}  // namespace rangecal
