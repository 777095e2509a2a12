// SPDX-License-Identifier: BSD-3-Clause
// Leaning cylinders seen by a tilted plane: the formula against rays in three dimensions, and what designs
// can see.
#include "rangecal/solvers/tilt/leaning.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "tilt/leaning_effect.hpp"

namespace rangecal {
namespace {

constexpr double degree = std::numbers::pi / 180.0;

world::World leaning_world(world::World world, double tilt_rad, double lean_rad) {
  world.head.tilt_rad = tilt_rad;
  world.head.tilt_axis_rad = 0.7;
  for (std::size_t l = 0; l < world.landmarks.size(); ++l) {
    world.landmarks[l].lean_rad = lean_rad;
    world.landmarks[l].lean_azimuth_rad = 2.0 * static_cast<double>(l) - 3.0;
  }
  return world;
}

TEST(LeaningEffect, HandWorkedValue) {
  // Plane tilted about the sensor's x axis by tau with tan(tau) = 0.1 (b0 = 0), a landmark at bearing pi/2, 2
  // m to the axis, heading -pi/2: n is the world's x. Height 2 x 0.1 x sin(pi/2) = 0.2 m; slope l = (0.05,
  // 0.03): the axis has moved by 10 mm away and 6 mm to the side (t is the world's y): 3 mrad. w = tan(tau) l
  // = (0.005, 0.003).
  const LeaningEffect effect(2);
  const double tau_sq = std::pow(std::atan(0.1), 2);
  const double plumb[6] = {tau_sq, 0.0, 0.0, 0.0, 0.0, 0.0},
               leaning[6] = {tau_sq, 0.0, 0.7, 0.7, 0.005, 0.003};
  ReadingView<double> at{};
  at.d = 1.9;
  at.axis_distance = 2.0;
  at.bearing = 0.5 * std::numbers::pi;
  at.heading = -0.5 * std::numbers::pi;
  at.slope = 0.9;
  at.landmark = 1;
  const ReadingChange<double> before = effect.reading(at, plumb), after = effect.reading(at, leaning);
  EXPECT_NEAR(after.range - before.range, 0.9 * 0.010, 1e-12);
  EXPECT_NEAR(after.bearing - before.bearing, 0.003, 1e-12);
}

TEST(LeaningEffect, IsWhatRaysMeet) {
  // Of the change that a lean of 3 degrees makes under a tilt of 4, traced in three dimensions, the formula
  // leaves a tenth: terms of second order in the lean and of the cylinder's curvature.
  const world::World plumb = leaning_world(world::make_turning_design(), 4.0 * degree, 0.0);
  const world::World leaning = leaning_world(world::make_turning_design(), 4.0 * degree, 3.0 * degree);
  const world::Expected before = world::expected(plumb), after = world::expected(leaning);
  const LeaningEffect effect(static_cast<int>(plumb.landmarks.size()));
  Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(effect.info().parameters.size()));
  p[0] = std::pow(4.0 * degree, 2) * std::cos(2.0 * 0.7);
  p[1] = std::pow(4.0 * degree, 2) * std::sin(2.0 * 0.7);
  const Eigen::VectorXd upright = p;
  const double slope = std::tan(3.0 * degree) * std::tan(4.0 * degree);
  double best = 1.0;
  for (const double sign : {1.0, -1.0}) {  // one sign for all leans
    for (std::size_t l = 0; l < plumb.landmarks.size(); ++l) {
      p[2 + 2 * static_cast<Eigen::Index>(l)] =
          sign * slope * std::cos(leaning.landmarks[l].lean_azimuth_rad);
      p[3 + 2 * static_cast<Eigen::Index>(l)] =
          sign * slope * std::sin(leaning.landmarks[l].lean_azimuth_rad);
    }
    double left = 0.0, whole = 0.0;
    for (std::size_t i = 0; i < before.range_mean_m.size(); ++i) {
      const Pose2& pose = before.stops[static_cast<std::size_t>(before.stop[i])];
      const world::Cylinder& cylinder = plumb.landmarks[static_cast<std::size_t>(before.landmark[i])];
      const double dx = cylinder.x_m - pose.x_m, dy = cylinder.y_m - pose.y_m;
      ReadingView<double> at{};
      at.axis_distance = std::hypot(dx, dy);
      at.d = at.axis_distance - cylinder.radius_m;
      at.heading = pose.heading_rad;
      at.bearing = std::remainder(std::atan2(dy, dx) - pose.heading_rad, 2.0 * std::numbers::pi);
      at.slope = 1.0;
      at.landmark = before.landmark[i];
      const double formula = effect.reading(at, p.data()).range - effect.reading(at, upright.data()).range;
      const double rays = after.range_mean_m[i] - before.range_mean_m[i];
      left += std::pow(rays - formula, 2);
      whole += rays * rays;
    }
    best = std::min(best, left / whole);
  }
  EXPECT_LT(std::sqrt(best), 0.1);
}

Recording recorded(const world::World& world, std::uint64_t seed) {
  return world::simulate(world, seed_from("leaning", {seed}));
}

TEST(Leaning, LeansAreEstimatedWhereTheDesignSeesThem) {
  const double lean_rad = 5.0 * degree;
  const world::World world = leaning_world(world::make_turning_design(), 8.0 * degree, lean_rad);
  const Recording recording = recorded(world, 1);
  const LeaningFit fit = fit_leaning({&recording, 1});
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_TRUE(fit.tilt_seen) << fit.statement;
  EXPECT_TRUE(fit.leans_seen) << fit.statement;
  EXPECT_LE(fit.tilt.low95, 8.0 * degree);
  EXPECT_GE(fit.tilt.high95, 8.0 * degree);
  ASSERT_EQ(fit.leans.size(), world.landmarks.size());
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(2);
  double right = 0.0, mirrored = 0.0;
  for (std::size_t l = 0; l < fit.leans.size(); ++l) {
    const LeanEstimate& lean = fit.leans[l];
    EXPECT_TRUE(lean.seen) << lean.landmark;
    const double azimuth = world.landmarks[l].lean_azimuth_rad;
    const Eigen::Vector2d truth = std::tan(lean_rad) * Eigen::Vector2d(std::cos(azimuth), std::sin(azimuth));
    right += (lean.slope - truth).dot(lean.covariance.inverse() * (lean.slope - truth));
    mirrored += (lean.slope + truth).dot(lean.covariance.inverse() * (lean.slope + truth));
  }
  // Chi-square with 12 degrees of freedom: 32.9 is its 99.9 % quantile.
  EXPECT_LT(std::min(right, mirrored), 32.9);
  EXPECT_GT(std::max(right, mirrored), 200.0) << "the other sign is another answer";
  EXPECT_EQ(fit.calibration.effects.count("tilt"), 1u);
}

TEST(Leaning, ALevelPlaneSeesNoLean) {
  const Recording recording = recorded(leaning_world(world::make_turning_design(), 0.0, 5.0 * degree), 2);
  const LeaningFit fit = fit_leaning({&recording, 1});
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_FALSE(fit.tilt_seen);
  EXPECT_EQ(fit.tilt.low95, 0.0);
  EXPECT_LT(fit.tilt.high95, 4.0 * degree);
  EXPECT_TRUE(fit.leans.empty());
  EXPECT_THAT(fit.statement,
              ::testing::HasSubstr("A cylinder's lean is seen, and does harm, in a tilted plane only"));
  EXPECT_TRUE(fit.calibration.effects.empty());
}

TEST(Leaning, AStraightLineSeesNeither) {
  const Recording recording =
      recorded(leaning_world(world::make_line_design(), 4.0 * degree, 5.0 * degree), 3);
  const LeaningFit fit = fit_leaning({&recording, 1});
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_FALSE(fit.tilt_seen);
  EXPECT_THAT(fit.statement, ::testing::HasSubstr("This design does not see a tilt"));
  EXPECT_THAT(fit.statement, ::testing::HasSubstr("Turn the sensor"));
}

TEST(Leaning, PlumbCylindersAreSaidToBe) {
  const Recording recording = recorded(leaning_world(world::make_turning_design(), 6.0 * degree, 0.0), 4);
  const LeaningFit fit = fit_leaning({&recording, 1});
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_TRUE(fit.tilt_seen);
  EXPECT_FALSE(fit.leans_seen) << fit.statement;
  EXPECT_THAT(fit.statement, ::testing::HasSubstr("No cylinder is seen to lean"));
}

TEST(Leaning, PairsAreRefused) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  EXPECT_THROW(fit_leaning({&recording, 1}), InputError);
}

}  // namespace
}  // namespace rangecal
