// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/polynomial_world.hpp"

#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <numbers>
#include <set>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using test::TemporaryFolder;

const std::string kData = std::string(RANGECAL_SOURCE_DIR) + "/notebooks_data/";

// Sum of n squared N(0, 1): mean n, deviation sqrt(2 n). Five deviations fail once in 10^6.
void expect_chi_square(double sum, double n) { EXPECT_NEAR(sum, n, 5.0 * std::sqrt(2.0 * n)); }
// Sum of n N(0, 1): deviation sqrt n.
void expect_centred(double sum, double n) { EXPECT_NEAR(sum, 0.0, 5.0 * std::sqrt(n)); }

TEST(PolynomialWorld, ShippedRecordingsAreWhatTheirScenesGive) {
  std::uint64_t seed = 0;
  for (const std::string name : {"2021-setting", "field-layout", "pairs-2016"}) {
    const TemporaryFolder folder;
    save_recording(simulate(load_scene(kData + "scenes/" + name + ".yaml"), ++seed), folder.path());
    for (const auto& entry : std::filesystem::directory_iterator(folder.path())) {
      const std::string file = entry.path().filename().string();
      EXPECT_EQ(read_file(entry.path().string()), read_file(kData + name + "/" + file))
          << name << "/" << file;
    }
  }
}

TEST(PolynomialWorld, SameSeedSameRecordingAndItReadsBack) {
  const Scene scene = load_scene(kData + "scenes/field-layout.yaml");
  const Recording one = simulate(scene, 7), two = simulate(scene, 7), other = simulate(scene, 8);
  EXPECT_EQ(one.readings.range_m, two.readings.range_m);
  EXPECT_NE(one.readings.range_m, other.readings.range_m);
  const TemporaryFolder folder;
  save_recording(one, folder.path());
  const Recording loaded = load_recording(folder.path());
  EXPECT_EQ(loaded.readings.range_m, one.readings.range_m);
  EXPECT_EQ(loaded.readings.bearing_rad, one.readings.bearing_rad);
  EXPECT_EQ(loaded.readings.row, one.readings.row);
  EXPECT_EQ(loaded.truth.landmarks, one.truth.landmarks);
}

TEST(PolynomialWorld, SettingsKeepTheirDistances) {
  for (const auto& [name, low, high] :
       {std::tuple("2021-setting", 0.5, 4.0), std::tuple("field-layout", 0.2, 5.0)}) {
    const Scene scene = load_scene(kData + "scenes/" + name + ".yaml");
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
      EXPECT_GT(std::abs(scene.positions[l].y()), 0.4);  // the path's line is y = 0
      for (const Stop& stop : scene.stops) {
        const double d =
            (scene.positions[l] - Eigen::Vector2d(stop.commanded.x_m, stop.commanded.y_m)).norm() -
            scene.landmarks[l].radius_m;
        EXPECT_GE(d, low) << name;
        EXPECT_LE(d, high) << name;
      }
    }
  }
}

TEST(PolynomialWorld, ReadingsHaveTheSceneMoments) {
  Scene scene = load_scene(kData + "scenes/field-layout.yaml");
  scene.repeats = 400;
  scene.sigma_heading_rad = 0.03;
  const Recording recording = simulate(scene, seed_from("ReadingsHaveTheSceneMoments"));
  const Readings& readings = recording.readings;
  ASSERT_EQ(readings.size(), 10u * 5u * 400u);
  double range = 0.0, range_sq = 0.0, bearing = 0.0, bearing_sq = 0.0, product = 0.0;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const Pose2 pose = *recording.truth.stops[static_cast<std::size_t>(readings.stop[i])];
    const Eigen::Vector2d axis = *recording.truth.landmarks[static_cast<std::size_t>(readings.landmark[i])];
    const Eigen::Vector2d gap = axis - Eigen::Vector2d(pose.x_m, pose.y_m);
    const double f = evaluate_polynomial(scene.alpha, gap.norm() - 0.12);
    const double e = (readings.range_m[i] - f) / (0.01 * f * f);
    const double theta = std::atan2(gap.y(), gap.x()) - pose.heading_rad;
    const double nu = wrap_angle(readings.bearing_rad[i] - theta) / scene.sigma_theta_rad;
    range += e;
    range_sq += e * e;
    bearing += nu;
    bearing_sq += nu * nu;
    product += e * nu;
  }
  const auto n = static_cast<double>(readings.size());
  expect_centred(range, n);
  expect_chi_square(range_sq, n);
  expect_centred(bearing, n);
  expect_chi_square(bearing_sq, n);
  expect_centred(product, n);  // independent: the product has variance 1
}

// Stop errors over many stops, whitened: independent ones, or a random walk's increments in the frame before.
void expect_stop_errors(StopErrorModel model) {
  Scene scene = load_scene(kData + "scenes/2021-setting.yaml");
  scene.stop_error = model;
  scene.sigma_xy_m = 0.02;
  scene.sigma_heading_rad = 0.05;
  scene.stops.clear();
  const int count = 3000;
  for (int k = 0; k < count; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = {0.3 * std::cos(0.01 * k), 0.2 * std::sin(0.02 * k), wrap_angle(0.01 * k)};
    scene.stops.push_back(stop);
  }
  const Recording recording =
      simulate(scene, seed_from("expect_stop_errors", {model == StopErrorModel::random_walk}));
  double sum = 0.0, squares = 0.0, heading = 0.0, heading_sq = 0.0;
  for (int k = 1; k < count; ++k) {
    const auto i = static_cast<std::size_t>(k);
    const auto local = [&](const Pose2& from, const Pose2& to) {
      const Eigen::Vector2d gap(to.x_m - from.x_m, to.y_m - from.y_m);
      return Eigen::Vector2d(Eigen::Rotation2Dd(-from.heading_rad) * gap);
    };
    const Pose2 &a = recording.stops[i - 1].commanded, &b = recording.stops[i].commanded;
    const Pose2 &c = *recording.truth.stops[i - 1], &d = *recording.truth.stops[i];
    const bool walk = model == StopErrorModel::random_walk;
    const Eigen::Vector2d error =
        walk ? Eigen::Vector2d(local(c, d) - local(a, b)) : Eigen::Vector2d(d.x_m - b.x_m, d.y_m - b.y_m);
    const double turn = walk ? wrap_angle(d.heading_rad - c.heading_rad - (b.heading_rad - a.heading_rad))
                             : wrap_angle(d.heading_rad - b.heading_rad);
    sum += (error.x() + error.y()) / 0.02;
    squares += error.squaredNorm() / (0.02 * 0.02);
    heading += turn / 0.05;
    heading_sq += turn * turn / (0.05 * 0.05);
  }
  expect_centred(sum, 2.0 * (count - 1));
  expect_chi_square(squares, 2.0 * (count - 1));
  expect_centred(heading, count - 1.0);
  expect_chi_square(heading_sq, count - 1.0);
}

TEST(PolynomialWorld, IndependentStopErrors) { expect_stop_errors(StopErrorModel::independent); }
TEST(PolynomialWorld, RandomWalkStopErrors) { expect_stop_errors(StopErrorModel::random_walk); }

TEST(PolynomialWorld, StopsOfOnePlaceShareTheirError) {
  Scene scene = load_scene(kData + "scenes/2021-setting.yaml");
  for (std::size_t k = 0; k < scene.stops.size(); ++k) {
    scene.stops[k].commanded = {1.0 * static_cast<double>(k / 4), 0.0, 0.5 * static_cast<double>(k % 4)};
    scene.stops[k].place = "p" + std::to_string(k / 4);
  }
  for (const StopErrorModel model : {StopErrorModel::independent, StopErrorModel::random_walk}) {
    scene.stop_error = model;
    const Recording recording = simulate(scene, 1);
    for (std::size_t k = 1; k < scene.stops.size(); ++k) {
      const bool same = recording.truth.stops[k]->x_m == recording.truth.stops[k - 1]->x_m &&
                        recording.truth.stops[k]->y_m == recording.truth.stops[k - 1]->y_m;
      EXPECT_EQ(same, k % 4 != 0) << k;
    }
  }
}

TEST(PolynomialWorld, RandomLandmarksKeepAwayFromPathAndEachOther) {
  Scene scene = load_scene(kData + "scenes/2021-setting.yaml");
  scene.landmarks.clear();
  scene.positions.clear();
  scene.random_landmarks = RandomLandmarks{8, {-2.0, -3.0}, {6.0, 3.0}, 0.4, 0.5, 0.1};
  for (std::uint64_t seed = 0; seed < 20; ++seed) {
    const Recording recording = simulate(scene, seed);
    ASSERT_EQ(recording.landmarks.size(), 8u);
    for (std::size_t l = 0; l < 8; ++l) {
      EXPECT_EQ(recording.landmarks[l].label, "R" + std::to_string(l));
      EXPECT_GE(std::abs(recording.truth.landmarks[l]->y()), 0.4);  // beyond the ends of the path, too
      for (std::size_t m = 0; m < l; ++m) {
        EXPECT_GE((*recording.truth.landmarks[l] - *recording.truth.landmarks[m]).norm(), 0.5);
      }
    }
  }
  scene.random_landmarks->box_max_m = {-1.9, -2.9};
  EXPECT_THROW(simulate(scene, 0), InputError);
}

TEST(PolynomialWorld, PairsHaveTheSceneMoments) {
  Scene scene = load_scene(kData + "scenes/pairs-2016.yaml");
  for (SceneBatch& batch : scene.batches) batch.readings = 1000;
  const Recording recording = simulate(scene, seed_from("PairsHaveTheSceneMoments"));
  ASSERT_EQ(recording.pairs.size(), 12000u);
  EXPECT_EQ(recording.pairs.batch_labels.size(), 12u);
  double sum = 0.0, squares = 0.0;
  for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
    const double f = evaluate_polynomial(scene.alpha, recording.pairs.true_m[i]);
    const double e = (recording.pairs.reading_m[i] - f) / (0.01 * f * f);
    sum += e;
    squares += e * e;
  }
  expect_centred(sum, 12000.0);
  expect_chi_square(squares, 12000.0);
}

TEST(PolynomialWorld, ASensorThatReadsNoBearingsReadsTheSameRanges) {
  const Scene scene = load_scene(kData + "scenes/field-layout.yaml");
  std::string text = read_file(kData + "scenes/field-layout.yaml");
  const std::size_t at = text.find("sigma_theta_rad: ") + 17;
  text.replace(at, text.find_first_of(",}\n #", at) - at, "none");
  const TemporaryFolder folder;
  folder.write("radio.yaml", text);
  const Scene radio = load_scene(folder.file("radio.yaml"));
  EXPECT_FALSE(radio.reads_bearings);
  const Recording ranges = simulate(radio, 7), both = simulate(scene, 7);
  EXPECT_TRUE(both.readings.has_bearings());
  EXPECT_FALSE(ranges.readings.has_bearings());
  EXPECT_EQ(ranges.readings.range_m, both.readings.range_m);
}

TEST(PolynomialWorld, VisibilityAndTheSensorsLimitsAreCounted) {
  Scene scene = load_scene(kData + "scenes/field-layout.yaml");
  scene.visible_max_m = 2.0;
  const Recording near = simulate(scene, 1);
  EXPECT_LT(near.readings.size(), 500u);
  EXPECT_EQ(near.counts.read, near.counts.used);
  scene.visible_max_m = 100.0;
  scene.sensor.range_max_m = 3.0;
  const Recording cut = simulate(scene, 1);
  EXPECT_GT(cut.counts.cells_left_out, 0);
  int dropped = 0;
  for (const auto& reason : cut.counts.dropped) dropped += reason.second;
  EXPECT_EQ(cut.counts.read, 500);
  EXPECT_EQ(cut.counts.used + dropped, 500);
  // Ten repeats: a cell is whole or left out.
  EXPECT_EQ(cut.readings.size(), static_cast<std::size_t>(10 * (50 - cut.counts.cells_left_out)));
}

TEST(PolynomialWorld, WhatCannotBeSimulatedIsSaid) {
  Scene scene = load_scene(kData + "scenes/pairs-2016.yaml");
  scene.noise.parameters[0] = 0.0;
  EXPECT_THROW(simulate(scene, 0), InputError);
  scene.alpha.resize(0);
  EXPECT_THROW(simulate(scene, 0), InputError);
}

}  // namespace
}  // namespace rangecal
