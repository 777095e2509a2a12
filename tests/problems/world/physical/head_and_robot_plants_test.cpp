// SPDX-License-Identifier: BSD-3-Clause
// Departures of the head and the robot against the linearised formulas of the catalogue.
#include <gtest/gtest.h>

#include <numbers>
#include <set>

#include "problems/world/physical/compare.hpp"

namespace rangecal::world::test {
namespace {

/// Range and bearing change of a reading whose sensor moved by (dx, dy) [m] and turned by turn [rad].
struct Moved {
  double range_m, bearing_rad;
};
Moved moved(const Change& change, std::size_t i, double dx, double dy, double turn) {
  const Pose2& stop = change.before.stops[static_cast<std::size_t>(change.before.stop[i])];
  const double direction = change.beam_rad[i] + stop.heading_rad;
  const double to_axis =
      change.distance_m[i] +
      change.planted.landmarks[static_cast<std::size_t>(change.before.landmark[i])].radius_m;
  return {-(dx * std::cos(direction) + dy * std::sin(direction)),
          (dx * std::sin(direction) - dy * std::cos(direction)) / to_axis - turn};
}

TEST(HeadPlants, ZeroAndCreep) {
  const Change zero = change_of(line(), "bearing_offset", 0.01745);
  EXPECT_LT(misfit(zero.bearing_rad, [](std::size_t) { return 0.01745; }), 1e-9);
  EXPECT_LT(rms(zero.range_m), 1e-12);
  const Change creep = change_of(line(), "bearing_drift", 0.00873);
  EXPECT_LT(misfit(creep.bearing_rad,
                   [&](std::size_t i) { return 0.00873 * creep.time_s[i] / run_length_s(line()); }),
            1e-6);
}

TEST(HeadPlants, BeamBesideTheAxis) {
  // db = psi0 - asin(q / D), D to the axis; from 0.5 to 5 m at 22 mm about 2.3 degrees.
  const Change change = change_of(turning(), "beam_offset", 0.022);
  const double squint = change.truth("beam_offset.squint_rad");
  EXPECT_LT(
      misfit(change.bearing_rad,
             [&](std::size_t i) {
               const double radius =
                   change.planted.landmarks[static_cast<std::size_t>(change.before.landmark[i])].radius_m;
               return squint - std::asin(0.022 / (change.distance_m[i] + radius));
             }),
      1e-6);
  EXPECT_LT(rms(change.range_m), 0.5e-3);
}

TEST(HeadPlants, EncoderDiscAndRing) {
  const Change disc = change_of(turning(), "encoder_eccentricity", 0.00873);
  EXPECT_LT(misfit(disc.bearing_rad,
                   [&](std::size_t i) {
                     return disc.truth("encoder_eccentricity.sin_rad") * std::sin(disc.beam_rad[i]) +
                            disc.truth("encoder_eccentricity.cos_rad") * std::cos(disc.beam_rad[i]);
                   }),
            0.02);
  const Change ring = change_of(turning(), "encoder_ellipticity", 0.00524);
  EXPECT_LT(misfit(ring.bearing_rad,
                   [&](std::size_t i) {
                     return ring.truth("encoder_ellipticity.sin_rad") * std::sin(2.0 * ring.beam_rad[i]) +
                            ring.truth("encoder_ellipticity.cos_rad") * std::cos(2.0 * ring.beam_rad[i]);
                   }),
            0.02);
}

TEST(HeadPlants, ScaleHasASeamBehind) {
  const Change change = change_of(turning(), "bearing_scale", 0.005);
  EXPECT_LT(misfit(change.bearing_rad, [&](std::size_t i) { return 0.005 * change.beam_rad[i]; }), 1e-6);
}

TEST(HeadPlants, BeamGridGivesHalfStepsAndTheSpreadOfTwoEdges) {
  World world = line();
  world.noise.sigma_theta_rad = 1e-6;  // no jitter: only the grid is left
  Random random(2);
  const double step = std::numbers::pi / 180.0;
  const World grid = apply(world, "bearing_quantisation", step, random);
  const Recording recording = simulate(grid, 1);
  for (const double bearing : recording.readings.bearing_rad) {
    const double halves = (bearing - grid.head.beam_grid_phase_rad) / (0.5 * step);
    EXPECT_NEAR(halves, std::round(halves), 1e-6);
  }
  const Change change = change_of(world, "bearing_quantisation", step);
  EXPECT_NEAR(rms(change.bearing_rad), step / std::sqrt(24.0), 0.2 * step / std::sqrt(24.0));
}

TEST(HeadPlants, RollingDuringTheSweep) {
  // dr = -v cos b (t_i - t0), with t_i - t0 = b / (2 pi) of a sweep; across, the bearing turns by v sin b
  // (t_i - t0) / D.
  const Change change = change_of(line(), "sweep_motion", 0.3);
  const auto moment = [&](std::size_t i) { return change.beam_rad[i] / (2.0 * std::numbers::pi) * 0.2; };
  EXPECT_LT(
      misfit(change.range_m, [&](std::size_t i) { return -0.3 * std::cos(change.beam_rad[i]) * moment(i); }),
      0.05);
  EXPECT_LT(misfit(change.bearing_rad,
                   [&](std::size_t i) { return moved(change, i, 0.3 * moment(i), 0.0, 0.0).bearing_rad; }),
            0.05);
}

TEST(HeadPlants, SwingDiesAwayOverTheRepeats) {
  const Change change = change_of(line(), "settling", 0.01745);
  EXPECT_LT(misfit(change.bearing_rad,
                   [&](std::size_t i) {
                     const double since = change.time_s[i] - change.before.stop[i] * (60.0 + 15 * 0.2);
                     return -0.01745 * std::exp(-since / change.truth("settling.time_s"));
                   }),
            0.1);  // the fast part of the damped swing is a twentieth
  // The amplitude is that of the catalogue's formula: at the first reading of a stop, less than when the robot stopped.
  double sum = 0.0;
  int stops = 0;
  for (std::size_t i = 0; i < change.bearing_rad.size(); ++i) {
    double first = change.time_s[i];
    for (std::size_t j = 0; j < change.bearing_rad.size(); ++j)
      if (change.before.stop[j] == change.before.stop[i]) first = std::min(first, change.time_s[j]);
    if (change.time_s[i] == first) sum -= change.bearing_rad[i], ++stops;
  }
  EXPECT_NEAR(change.truth("settling.amplitude_rad"), sum / stops, 2e-4);
  EXPECT_LT(change.truth("settling.amplitude_rad"), 0.01745);
}

TEST(RobotPlants, PathScaleCurvatureAndDrift) {
  const Change scale = change_of(turning(), "odometry_scale", 0.01);
  for (std::size_t k = 0; k < scale.after.stops.size(); ++k) {
    EXPECT_NEAR(scale.after.stops[k].x_m, 1.01 * scale.before.stops[k].x_m, 1e-9);
    EXPECT_NEAR(scale.after.stops[k].y_m, 1.01 * scale.before.stops[k].y_m, 1e-9);
    EXPECT_NEAR(wrap_angle(scale.after.stops[k].heading_rad - scale.before.stops[k].heading_rad), 0.0, 1e-9);
  }
  const Change curve = change_of(line(), "path_curvature", 0.02);
  for (std::size_t k = 0; k < curve.after.stops.size(); ++k) {
    const double path = curve.before.stops[k].x_m;  // lateral kappa l^2 / 2, heading kappa l
    EXPECT_NEAR(curve.after.stops[k].heading_rad, 0.02 * path, 1e-6);
    EXPECT_NEAR(curve.after.stops[k].y_m, 0.01 * path * path, 1e-4);
  }
  // Turning on the spot, the robot goes about the point kappa w^2 / 4 to its left.
  const Change turns = change_of(turning(), "path_curvature", 0.02);
  const Pose2 &first = turns.after.stops[0], &second = turns.after.stops[1];
  const double offset = 0.02 * 0.4 * 0.4 / 4.0;
  EXPECT_NEAR(second.x_m - first.x_m, offset * (std::sin(second.heading_rad) - std::sin(first.heading_rad)),
              1e-6);
  EXPECT_NEAR(second.y_m - first.y_m, offset * (std::cos(first.heading_rad) - std::cos(second.heading_rad)),
              1e-6);
  const Change drift = change_of(line(), "heading_drift", 0.01745);
  EXPECT_LT(misfit(drift.bearing_rad,
                   [&](std::size_t i) { return -0.01745 * drift.time_s[i] / run_length_s(line()); }),
            1e-6);
  EXPECT_LT(rms(drift.range_m), 1e-9);
}

TEST(RobotPlants, LeverArmTurnsWithTheHeading) {
  const Change change = change_of(turning(), "lever_arm", 0.02);
  const double qx = change.truth("lever_arm.x_m"), qy = change.truth("lever_arm.y_m");
  const auto arm = [&](std::size_t i) {
    const double heading = change.before.stops[static_cast<std::size_t>(change.before.stop[i])].heading_rad;
    return moved(change, i, std::cos(heading) * qx - std::sin(heading) * qy,
                 std::sin(heading) * qx + std::cos(heading) * qy, 0.0);
  };
  EXPECT_LT(misfit(change.range_m, [&](std::size_t i) { return arm(i).range_m; }), 0.05);
  EXPECT_LT(misfit(change.bearing_rad, [&](std::size_t i) { return arm(i).bearing_rad; }), 0.1);
}

TEST(RobotPlants, SlipMovesAllLaterStops) {
  for (const World& world : {line(), turning()}) {
    const Change change = change_of(world, "wheel_slip", 0.05);
    const std::size_t first = static_cast<std::size_t>(change.truth("wheel_slip.stop"));
    const double heading = world.robot.stops[first].commanded.heading_rad;
    ASSERT_GT(first, 0u);
    for (std::size_t k = 0; k < change.after.stops.size(); ++k) {
      const double slip = k >= first ? 0.05 : 0.0;
      EXPECT_NEAR(change.after.stops[k].x_m - change.before.stops[k].x_m, slip * std::cos(heading), 1e-9);
      EXPECT_NEAR(change.after.stops[k].y_m - change.before.stops[k].y_m, slip * std::sin(heading), 1e-9);
    }
  }
}

TEST(RobotPlants, WalkAccumulates) {
  Random random(1);
  const World world = apply(line(), "odometry_random_walk", 0.01, random);
  double last = 0.0, early = 0.0;
  constexpr int runs = 400;
  for (std::uint64_t seed = 0; seed < runs; ++seed) {
    const Placing placing = placing_of(world, seed);
    last += std::pow(placing.error.back().x_m, 2) / runs;
    early += std::pow(placing.error[1].x_m, 2) / runs;
  }
  EXPECT_NEAR(std::sqrt(early), 0.01, 0.0015);                   // one step, 4 sd of a spread from 400 draws
  EXPECT_NEAR(std::sqrt(last), 0.01 * std::sqrt(19.0), 0.0065);  // 19 steps
}

TEST(RobotPlants, PushedLandmark) {
  const Change change = change_of(line(), "moved_landmark", 0.02);
  const auto push = [&](std::size_t i) {
    const bool later = change.before.landmark[i] == change.truth("moved_landmark.landmark") &&
                       change.time_s[i] > change.truth("moved_landmark.time_s");
    return later ? moved(change, i, -change.truth("moved_landmark.x_m"), -change.truth("moved_landmark.y_m"),
                         0.0)
                 : Moved{0.0, 0.0};
  };
  EXPECT_LT(misfit(change.range_m, [&](std::size_t i) { return push(i).range_m; }), 0.1);
  EXPECT_LT(misfit(change.bearing_rad, [&](std::size_t i) { return push(i).bearing_rad; }), 0.1);
}

TEST(DriverPlants, LabelsAndDropouts) {
  Random random(4);
  const World swapped = apply(line(), "label_swap", 3.0, random);
  const Recording with = simulate(swapped, 1), without = simulate(line(), 1);
  std::set<int> stops;
  for (std::size_t i = 0; i < with.readings.size(); ++i)
    if (with.readings.landmark[i] != without.readings.landmark[i]) stops.insert(with.readings.stop[i]);
  EXPECT_EQ(stops.size(), 3u);
  EXPECT_EQ(with.readings.range_m, without.readings.range_m);

  const World dim = apply(line(), "dropout", 0.3, random);
  const Recording cut = simulate(dim, 1);
  EXPECT_LT(cut.readings.size(), without.readings.size());
  const Expected out = expected(dim), full = expected(line());
  double seen = 0.0;
  for (std::size_t i = 0; i < out.detection.size(); ++i) {
    seen += out.detection[i];
    EXPECT_LE(out.range_mean_m[i], full.range_mean_m[i] + 1e-9);  // inverse Mills: seen readings are shorter
  }
  EXPECT_NEAR(seen, static_cast<double>(cut.readings.size()), 30.0);
}

}  // namespace
}  // namespace rangecal::world::test
