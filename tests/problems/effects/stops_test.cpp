// SPDX-License-Identifier: BSD-3-Clause
// What effects do to the stops of example.hpp: (0,0) (1,0) (2,0) heading 0; (2,0) (2,1) (2,2) heading 90
// degrees.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "problems/effects/example.hpp"

namespace rangecal {
namespace {

using effects_testing::example_context;
using effects_testing::example_stops;

std::vector<StopPrior> changed(const std::string& id, const std::vector<double>& p) {
  const EffectContext context = example_context();
  std::vector<StopPrior> stops = example_stops(context);
  const Effect* effect = find_effect(id);
  EXPECT_TRUE(effect->acts_on_stops());
  effect->stops(context, p.data(), stops);
  return stops;
}

void expect_pose(const StopPrior& stop, double x, double y, double heading) {
  EXPECT_NEAR(stop.commanded.x_m, x, 1e-12);
  EXPECT_NEAR(stop.commanded.y_m, y, 1e-12);
  EXPECT_NEAR(stop.commanded.heading_rad, heading, 1e-12);
}

constexpr double quarter = std::numbers::pi / 2;

TEST(EffectStops, OdometryScaleStretchesAboutTheFirstStop) {
  const auto stops = changed("odometry_scale", {0.01});
  expect_pose(stops[0], 0.0, 0.0, 0.0);
  expect_pose(stops[5], 2.02, 2.02, quarter);
}

TEST(EffectStops, OdometryScaleStartsAnewInEachRecording) {
  const EffectContext context = example_context();
  std::vector<StopPrior> stops = example_stops(context);
  for (int k = 3; k < 6; ++k) stops[static_cast<std::size_t>(k)].recording = 1;
  const double p[] = {0.01};
  find_effect("odometry_scale")->stops(context, p, stops);
  expect_pose(stops[2], 2.02, 0.0, 0.0);
  expect_pose(stops[3], 2.0, 0.0, quarter);
  expect_pose(stops[5], 2.0, 2.02, quarter);
}

TEST(EffectStops, PathCurvatureTurnsStepsByTheirMeanHeading) {
  // steps of 1 m turned by kappa times 0.5, 1.5, (none), 2.5, 3.5 m
  const double k = 0.02;
  const auto stops = changed("path_curvature", {k, 0.0});
  expect_pose(stops[1], std::cos(0.5 * k), std::sin(0.5 * k), k);
  const double x2 = std::cos(0.5 * k) + std::cos(1.5 * k), y2 = std::sin(0.5 * k) + std::sin(1.5 * k);
  expect_pose(stops[2], x2, y2, 2 * k);
  expect_pose(stops[3], x2, y2, quarter + 2 * k);
  expect_pose(stops[4], x2 - std::sin(2.5 * k), y2 + std::cos(2.5 * k), quarter + 3 * k);
}

TEST(EffectStops, PathCurvatureBendsALineByHalfKappaLengthSquared) {
  // 1/2 * 0.02 * 2^2 = 0.04, to third order in kappa l
  EXPECT_NEAR(changed("path_curvature", {0.02, 0.0})[2].commanded.y_m, 0.04, 2e-5);
}

TEST(EffectStops, UnequalWheelsTurnAboutAPointToTheLeft) {
  // kappa w^2 / 4 = 0.02 * 0.16 / 4 = 0.0008 m to the left: a quarter turn to the left moves the robot by as much forwards and to the
  // left, in its heading before the turn, which is 2 kappa.
  const auto about_itself = changed("path_curvature", {0.02, 0.0}),
             about_a_point = changed("path_curvature", {0.02, 0.4});
  const double c = std::cos(0.04), s = std::sin(0.04), offset = 0.0008;
  const Pose2 &before = about_a_point[2].commanded, &after = about_a_point[3].commanded;
  EXPECT_NEAR(after.x_m - before.x_m, offset * (c - s), 1e-12);
  EXPECT_NEAR(after.y_m - before.y_m, offset * (s + c), 1e-12);
  expect_pose(about_a_point[0], 0.0, 0.0, 0.0);
  for (std::size_t k = 0; k < about_itself.size(); ++k)
    EXPECT_EQ(about_a_point[k].commanded.heading_rad, about_itself[k].commanded.heading_rad);
}

TEST(EffectStops, TurnScaleTurnsWhatFollowsATurn) {
  // the only turn, of a quarter before stop 3, is larger by 4 %: 0.0628318531 rad from there on
  const double more = 0.04 * quarter;
  const auto stops = changed("turn_scale", {0.04});
  expect_pose(stops[2], 2.0, 0.0, 0.0);
  expect_pose(stops[3], 2.0, 0.0, quarter + more);
  expect_pose(stops[4], 2.0 - std::sin(more), std::cos(more), quarter + more);
  expect_pose(stops[5], 2.0 - 2 * std::sin(more), 2 * std::cos(more), quarter + more);
}

TEST(EffectStops, TurnScaleCountsTurnsAcrossTheSeamAndAnewInEachRecording) {
  EffectContext context = example_context();
  for (int k = 0; k < 6; ++k)
    context.commanded[static_cast<std::size_t>(k)].heading_rad = std::remainder(2.0 * k, 4.0 * quarter);
  std::vector<StopPrior> stops = example_stops(context);
  for (int k = 4; k < 6; ++k) stops[static_cast<std::size_t>(k)].recording = 1;
  const double p[] = {0.05};
  find_effect("turn_scale")->stops(context, p, stops);
  EXPECT_NEAR(stops[3].commanded.heading_rad - context.commanded[3].heading_rad, 0.05 * 6.0, 1e-12);
  EXPECT_NEAR(stops[4].commanded.heading_rad, context.commanded[4].heading_rad, 1e-12);
  EXPECT_NEAR(stops[5].commanded.heading_rad - context.commanded[5].heading_rad, 0.05 * 2.0, 1e-12);
}

TEST(EffectStops, TurnScaleIsATrackThatIsNotTheOneStated) {
  // A robot of track w is driven by its wheels along an arc that it takes for one of the stated track: wheels' ways +-w a / 2
  // turn it by a w_stated / w. Against the arc in many small steps; chords of 0.1 rad and 0.05 m leave (0.1)^2 / 24 of a step.
  const double stated = 0.15, track = 0.173, turn = 0.1, step = 0.05;
  EffectContext context = example_context();
  Pose2 meant, driven;
  std::vector<Pose2> truth;
  constexpr int pieces = 1000;
  for (Pose2& pose : context.commanded) {
    pose = meant;
    truth.push_back(driven);
    meant = {meant.x_m + step * std::cos(meant.heading_rad + turn / 2),
             meant.y_m + step * std::sin(meant.heading_rad + turn / 2), meant.heading_rad + turn};
    const double left = step - turn * stated / 2, right = step + turn * stated / 2;  // ways of the wheels [m]
    for (int i = 0; i < pieces; ++i) {
      const double angle = (right - left) / track / pieces, middle = driven.heading_rad + angle / 2;
      driven = {driven.x_m + (left + right) / 2 / pieces * std::cos(middle),
                driven.y_m + (left + right) / 2 / pieces * std::sin(middle), driven.heading_rad + angle};
    }
  }
  std::vector<StopPrior> stops = example_stops(context);
  const double p[] = {stated / track - 1.0};
  find_effect("turn_scale")->stops(context, p, stops);
  for (std::size_t k = 0; k < stops.size(); ++k) {
    EXPECT_NEAR(stops[k].commanded.x_m, truth[k].x_m, 1e-4);
    EXPECT_NEAR(stops[k].commanded.y_m, truth[k].y_m, 1e-4);
    EXPECT_NEAR(stops[k].commanded.heading_rad, truth[k].heading_rad, 1e-12);
  }
}

TEST(EffectStops, TurnScaleTakesAPathWithTurns) {
  EffectContext context = example_context();
  const Effect& turns = *find_effect("turn_scale");
  EXPECT_EQ(turns.missing(context), "");
  for (Pose2& pose : context.commanded) pose.heading_rad = 0.3;
  EXPECT_NE(turns.missing(context), "");
}

TEST(EffectStops, ScanLatencyMovesAlongThePath) {
  // v tau to first order, v between the stops before and after: at stop 1 2 m in 75 s, at stop 5 its own last 1 m in 195 s; the
  // path's bend adds some (tau / 25 s)^2 of a metre
  const double tau = 1e-3;
  const auto stops = changed("scan_latency", {tau});
  EXPECT_NEAR(stops[1].commanded.x_m, 1.0 + tau * 2.0 / 75.0, 1e-8);
  EXPECT_NEAR(stops[5].commanded.y_m, 2.0 + tau * 1.0 / 195.0, 1e-8);
  // at stop 3 a quarter turn between stops 2 and 4, 125 s apart
  EXPECT_NEAR(stops[3].commanded.heading_rad, quarter + tau * quarter / 125.0, 1e-8);
}

TEST(EffectStops, ScanLatencyFollowsABendingPath) {
  // A circle of radius 1 m at 0.5 rad/s, read every 0.2 s: half a second later the robot is 0.25 rad on. Chords of 0.1 rad
  // leave an error of 0.1^2 / 6 of the speed in each tangent: 0.1^3 / 24 m at most between the stops.
  EffectContext context = example_context();
  context.commanded.clear();
  context.stop_time_s.clear();
  const auto on_circle = [](double t) {
    return Pose2{std::sin(0.5 * t), -std::cos(0.5 * t), std::remainder(0.5 * t, 4.0 * quarter)};
  };
  for (int k = 0; k < 60; ++k) {
    context.stop_time_s.push_back(0.2 * k);
    context.commanded.push_back(on_circle(0.2 * k));
  }
  context.stop_count = 60;
  context.duration_s = 11.8;
  EXPECT_EQ(find_effect("scan_latency")->missing(context), "");
  context.stop_time_s[20] = context.stop_time_s[21] = 0.0;  // no reading there
  for (const double tau : {0.5, -0.5}) {
    std::vector<StopPrior> stops = example_stops(context);
    find_effect("scan_latency")->stops(context, &tau, stops);
    for (std::size_t k = 5; k < 55; ++k) {
      const Pose2 truth = on_circle(0.2 * static_cast<double>(k) + tau);
      EXPECT_NEAR(stops[k].commanded.x_m, truth.x_m, 1e-4);
      EXPECT_NEAR(stops[k].commanded.y_m, truth.y_m, 1e-4);
      EXPECT_NEAR(std::remainder(stops[k].commanded.heading_rad - truth.heading_rad, 4.0 * quarter), 0.0,
                  1e-12);
    }
  }
}

TEST(EffectStops, ScanLatencyTakesMotion) {
  EffectContext context = example_context();  // 6 stops in 400 s
  const Effect& latency = *find_effect("scan_latency");
  EXPECT_EQ(latency.missing(context), "");
  context.stay_s = 40.0;
  EXPECT_NE(latency.missing(context), "") << "it stands while it reads";
  context.kind = RecordingKind::pairs;
  EXPECT_NE(latency.missing(context), "");
  context.largest_rate_mps = 0.1;
  EXPECT_EQ(latency.missing(context), "");
}

TEST(EffectStops, HeadingDriftFollowsTime) {
  const auto stops = changed("heading_drift", {0.02});
  expect_pose(stops[0], 0.0, 0.0, 0.0);
  expect_pose(stops[1], 1.0, 0.0, 0.0025);          // 0.02 * 50 / 400
  expect_pose(stops[4], 2.0, 1.0, quarter + 0.01);  // 0.02 * 200 / 400
}

TEST(EffectStops, HeadingAndBearingDriftAreTwins) {
  // a heading that grows by h turns the bearing b = direction - heading by -h
  const EffectContext context = example_context();
  const auto stops = changed("heading_drift", {0.02});
  auto at = effects_testing::example_reading(context);
  at.stop = 4;
  at.time = 200.0 / 400.0;
  const double p[] = {-0.02};
  EXPECT_NEAR(find_effect("bearing_drift")->reading(at, p).bearing,
              -(stops[4].commanded.heading_rad - context.commanded[4].heading_rad), 1e-15);
}

TEST(EffectStops, LeverArmTurnsWithTheRobot) {
  const auto stops = changed("lever_arm", {0.02, 0.01});
  expect_pose(stops[0], 0.02, 0.01, 0.0);
  expect_pose(stops[4], 2.0 - 0.01, 1.0 + 0.02, quarter);
}

TEST(EffectStops, WheelSlipMovesAllLaterStopsAlongTheStep) {
  const auto stops = changed("wheel_slip", {0.05, 4.0});
  expect_pose(stops[3], 2.0, 0.0, quarter);
  expect_pose(stops[4], 2.0, 1.05, quarter);
  expect_pose(stops[5], 2.0, 2.05, quarter);
}

TEST(EffectStops, WheelSlipKnowsTheStepFromTheHeading) {
  // The robot drove to stop 1 along x and turned there; at stop 2 it only turned on.
  std::vector<StopPrior> stops(4);
  for (int k = 0; k < 4; ++k)
    stops[k].commanded = {k < 1 ? 0.0 : k < 3 ? 1.0 : 2.0, 0.0, k < 1 ? 0.0 : 1.0 + k};
  const auto slipped = [&](int from) {
    std::vector<StopPrior> moved = stops;
    const double p[] = {0.05, static_cast<double>(from)};
    find_effect("wheel_slip")->stops({}, p, moved);
    return moved;
  };
  EXPECT_EQ(slipped(1)[0].commanded.x_m, 0.0);
  EXPECT_NEAR(slipped(1)[1].commanded.x_m, 1.05, 1e-15);
  EXPECT_NEAR(slipped(1)[3].commanded.x_m, 2.05, 1e-15);
  EXPECT_NEAR(slipped(1)[3].commanded.y_m, 0.0, 1e-15);
  EXPECT_NEAR(slipped(2)[2].commanded.x_m, 1.0 + 0.05 * std::cos(3.0), 1e-15);  // no step: its heading
  EXPECT_NEAR(slipped(2)[2].commanded.y_m, 0.05 * std::sin(3.0), 1e-15);
}

TEST(EffectStops, RandomWalkChainsEveryPlaceButTheFirst) {
  const auto stops = changed("odometry_random_walk", {0.02});
  EXPECT_FALSE(stops[0].chained);
  EXPECT_EQ(stops[0].sigma_xy_m, 0.01);
  EXPECT_TRUE(stops[1].chained);
  EXPECT_EQ(stops[1].sigma_xy_m, 0.02);
  EXPECT_FALSE(stops[3].chained) << "the sensor was turned there, not moved";
  EXPECT_TRUE(stops[4].chained);
}

TEST(EffectStops, StopEffectWidensThePriors) {
  const auto stops = changed("stop_effect", {0.024, 0.012});
  EXPECT_NEAR(stops[2].sigma_xy_m, 0.026, 1e-15);         // 10, 24, 26
  EXPECT_NEAR(stops[2].sigma_heading_rad, 0.013, 1e-15);  // 5, 12, 13
}

TEST(EffectStops, StatedSigmaIsOffByOneFactor) {
  const auto stops = changed("stated_sigma", {std::log(3.0)});
  EXPECT_NEAR(stops[2].sigma_xy_m, 0.03, 1e-15);
  EXPECT_NEAR(stops[2].sigma_heading_rad, 0.005, 1e-15);
}

}  // namespace
}  // namespace rangecal
