// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <filesystem>
#include <fstream>
#include <numbers>

#include "problems/world/physical/compare.hpp"
#include "rangecal/problems/world/physical/cylinder_geometry.hpp"
#include "rangecal/problems/world/physical/optical_sensor.hpp"

namespace rangecal::world::test {
namespace {

TEST(IdealWorld, ReadingAtAKnownPlaceIsPlaneGeometry) {
  World world;
  Stop stop;
  stop.label = "1";
  stop.commanded = {1.0, 1.0, std::numbers::pi / 2};
  world.robot.stops = {stop};
  Cylinder landmark;
  landmark.label = "A", landmark.x_m = 4.0, landmark.y_m = 5.0;
  world.landmarks = {landmark};
  world.timing.repeats = 1;
  const Expected out = expected(world);
  // (3, 4) away: 5 m to the axis, 4.88 m to the surface; atan2(4, 3) - pi/2 = 0.9272952 - 1.5707963
  EXPECT_NEAR(out.range_mean_m[0], 4.88, 1e-12);
  EXPECT_NEAR(out.bearing_mean_rad[0], -0.6435011, 1e-7);
  EXPECT_NEAR(out.range_sd_m[0], 0.004 * 4.88 * 4.88, 1e-12);
  EXPECT_NEAR(out.bearing_sd_rad[0], std::numbers::pi / 360, 1e-9);
  EXPECT_EQ(out.detection[0], 1.0);
}

TEST(IdealWorld, FirmwareInvertsTheSensorItBelievesIn) {
  const OpticalSensor sensor;
  const double x = centroid_mm(sensor, {}, {}, 2.0, 0.0, 0.0);
  EXPECT_NEAR(x, 0.36, 1e-12);  // 14.4 mm * 50 mm / 2000 mm
  EXPECT_NEAR(firmware_range_m(sensor, x, 2.0, 0.0), 2.0, 1e-12);
}

TEST(IdealWorld, IntersectionInThreeDimensionsAgreesWithThePlane) {
  SpinningHead level, barely_tilted;
  barely_tilted.tilt_rad = 1e-12;  // takes the general path
  for (const double beam_offset : {0.0, 0.02}) {
    level.beam_offset_m = barely_tilted.beam_offset_m = beam_offset;
    Cylinder cylinder;
    cylinder.x_m = -0.7, cylinder.y_m = 1.1;
    const Pose2 pose{0.3, -0.2, 0.4};
    const Sight plane = look_at(level, cylinder, pose, 0.0),
                space = look_at(barely_tilted, cylinder, pose, 0.0);
    EXPECT_NEAR(plane.distance_m, space.distance_m, 1e-10);
    EXPECT_NEAR(plane.head_rad, space.head_rad, 1e-10);
  }
}

TEST(IdealWorld, CurveOfEachDesignIsAQuadraticToATenthOfAMillimetre) {
  Random random(seed_from("vary", {7}));
  for (const World& design : {make_line_design(), make_turning_design()})
    for (int unit = 0; unit < 4; ++unit) {
      const World world = unit == 0 ? design : vary(design, random);
      const Expected out = expected(world);
      const Eigen::Index n = static_cast<Eigen::Index>(out.distance_m.size());
      Eigen::MatrixXd powers(n, 3);
      Eigen::VectorXd range(n);
      double low = 1e9, high = 0.0;
      for (Eigen::Index i = 0; i < n; ++i) {
        const double d = out.distance_m[static_cast<std::size_t>(i)];
        powers.row(i) << 1.0, d, d * d;
        range[i] = out.range_mean_m[static_cast<std::size_t>(i)];
        low = std::min(low, d), high = std::max(high, d);
      }
      const Eigen::VectorXd off = range - powers * powers.colPivHouseholderQr().solve(range);
      EXPECT_LT(std::sqrt(off.squaredNorm() / static_cast<double>(n)), 1e-4) << world.name;
      EXPECT_GT(low, 0.2) << world.name;
      EXPECT_LT(low, 0.65) << world.name;
      EXPECT_GT(high, 3.5) << world.name;
      EXPECT_LT(high, 4.8) << world.name;
      EXPECT_GT(range.size(), 1400);
    }
}

TEST(IdealWorld, CleanWorldsAreTheSeedModel) {
  // What a quadratic leaves of the range means, in units of their spread, bounds the noncentrality against
  // the seed model from above; the spread is sigma f^2 exactly, and bearings are those of plane geometry.
  Random random(seed_from("clean", {1}));
  for (const World& design : {make_line_design(), make_turning_design()})
    for (int unit = 0; unit < 10; ++unit) {
      const World world = vary(design, random);
      const Expected out = expected(world);
      const Eigen::Index n = static_cast<Eigen::Index>(out.distance_m.size());
      Eigen::MatrixXd powers(n, 3);
      Eigen::VectorXd range(n);
      for (Eigen::Index i = 0; i < n; ++i) {
        const std::size_t k = static_cast<std::size_t>(i);
        const double d = out.distance_m[k], f = out.range_mean_m[k], sd = out.range_sd_m[k];
        EXPECT_NEAR(sd, world.noise.speckle_per_m * f * f, 1e-12);
        powers.row(i) << 1.0 / sd, d / sd, d * d / sd;
        range[i] = f / sd;
        const Pose2& stop = world.robot.stops[static_cast<std::size_t>(out.stop[k])].commanded;
        const Cylinder& landmark = world.landmarks[static_cast<std::size_t>(out.landmark[k])];
        const double direction = std::atan2(landmark.y_m - stop.y_m, landmark.x_m - stop.x_m);
        EXPECT_NEAR(wrap_angle(out.bearing_mean_rad[k] - direction + stop.heading_rad), 0.0, 1e-9);
        EXPECT_EQ(out.detection[k], 1.0);
        EXPECT_EQ(out.tail_share[k], 0.0);
      }
      EXPECT_LT((range - powers * powers.colPivHouseholderQr().solve(range)).squaredNorm(), 0.1);
      EXPECT_EQ(out.cell_sd_m + out.smoothing + out.walk_sigma_m + out.bearing_grid_rad + out.range_step_m,
                0.0);
    }
}

TEST(IdealWorld, RepeatsHaveTheStatedMeanAndSpread) {
  World world = make_line_design();
  world.timing.repeats = 400;
  const Recording recording = simulate(world, 11);
  const Expected out = expected(world, placing_of(world, 11));
  ASSERT_EQ(recording.readings.size(), out.stop.size());
  double chi_range = 0.0, chi_bearing = 0.0;
  const double n = static_cast<double>(out.stop.size());
  for (std::size_t i = 0; i < out.stop.size(); ++i) {
    chi_range += std::pow((recording.readings.range_m[i] - out.range_mean_m[i]) / out.range_sd_m[i], 2);
    chi_bearing += std::pow(
        wrap_angle(recording.readings.bearing_rad[i] - out.bearing_mean_rad[i]) / out.bearing_sd_rad[i], 2);
  }
  EXPECT_NEAR(chi_range / n, 1.0, 5.0 * std::sqrt(2.0 / n));  // five standard deviations of a mean square
  EXPECT_NEAR(chi_bearing / n, 1.0, 5.0 * std::sqrt(2.0 / n));
}

TEST(IdealWorld, SameSeedSameBitsAndAnotherSeedAnother) {
  const World world = make_turning_design();
  const Recording a = simulate(world, 3), b = simulate(world, 3), c = simulate(world, 4);
  EXPECT_EQ(a.readings.range_m, b.readings.range_m);
  EXPECT_EQ(a.readings.bearing_rad, b.readings.bearing_rad);
  EXPECT_EQ(a.readings.covariates, b.readings.covariates);
  EXPECT_NE(a.readings.range_m, c.readings.range_m);
}

TEST(IdealWorld, PlacesShareTheirErrorAndStopsStayNearTheCommand) {
  const World world = make_turning_design();
  const Placing placing = placing_of(world, 5);
  ASSERT_EQ(placing.error.size(), 24u);
  for (int k = 1; k < 4; ++k) EXPECT_EQ(placing.error[static_cast<std::size_t>(k)].x_m, placing.error[0].x_m);
  EXPECT_NE(placing.error[4].x_m, placing.error[0].x_m);
  EXPECT_NE(placing.error[1].heading_rad, placing.error[0].heading_rad);
  const std::vector<Pose2> stops = true_stops(world, no_placing_error(world));
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const Pose2& commanded = world.robot.stops[k].commanded;
    EXPECT_NEAR(stops[k].x_m, commanded.x_m, 1e-12);
    EXPECT_NEAR(stops[k].y_m, commanded.y_m, 1e-12);
    EXPECT_NEAR(wrap_angle(stops[k].heading_rad - commanded.heading_rad), 0.0, 1e-12);
  }
}

TEST(IdealWorld, RecordingSaysNothingAboutThePlant) {
  Random random(1);
  const Recording recording = simulate(apply(make_line_design(), "tilt", 0.1, random), 1);
  EXPECT_EQ(recording.sensor.name, "spinning-triangulation-lidar");
  EXPECT_TRUE(recording.path.empty());
  EXPECT_EQ(recording.landmarks.size(), 5u);
  EXPECT_EQ(recording.truth.stops.size(), 20u);
}

TEST(IdealWorld, SharesNothingWithTheDiagnosisButCore) {
  namespace fs = std::filesystem;
  const fs::path root = RANGECAL_SOURCE_DIR;
  int files = 0;
  for (const fs::path& folder :
       {root / "problems/include/rangecal/problems/world/physical", root / "problems/src/world/physical"})
    for (const fs::directory_entry& entry : fs::recursive_directory_iterator(folder)) {
      if (entry.path().extension() != ".hpp" && entry.path().extension() != ".cpp") continue;
      ++files;
      std::ifstream stream(entry.path());
      for (std::string line; std::getline(stream, line);) {
        const bool include =
            line.find("#include") != std::string::npos && line.find('/') != std::string::npos;
        if (!include || line.find("<Eigen/") != std::string::npos) continue;
        if (line.find("\"rangecal/core/") != std::string::npos) continue;
        EXPECT_THAT(line, ::testing::HasSubstr("rangecal/problems/world/physical/")) << entry.path();
      }
    }
  EXPECT_GT(files, 15);
}

}  // namespace
}  // namespace rangecal::world::test
