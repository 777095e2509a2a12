// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/extract.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iostream>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/scans.hpp"
#include "rangecal/solvers/extract/assignment.hpp"

namespace rangecal {
namespace {

using world::ScanScene;
using world::SimulatedScans;
using world::World;

/// An ideal sensor: what it reads is the distance, but for noise.
World ideal(World world, double speckle) {
  world.sensor = world::OpticalSensor();
  world.noise.speckle_per_m = speckle, world.noise.floor_m = 0.002;
  return world;
}

ScanScene room(double step_rad) {
  ScanScene scene;
  scene.walls = {{-4, -4, 6, -4}, {6, -4, 6, 5}, {6, 5, -4, 5}, {-4, 5, -4, -4}};
  scene.step_rad = step_rad;
  scene.beams = static_cast<int>(std::lround(2.0 * std::numbers::pi / step_rad));
  return scene;
}

ExtractOptions options_for(const World& world, std::vector<double> radii) {
  ExtractOptions options;
  options.cylinder.radii_m = std::move(radii);
  options.association.sigma_xy_m = world.robot.stated_sigma_m;
  options.association.sigma_heading_rad = world.robot.stated_heading_sigma_rad;
  return options;
}

/// Mean of the squares of errors over their stated standard deviations, and its standard error: the repeats of a cell share
/// the grid of the beams, so cells, not readings, are independent.
class ChiSquare {
 public:
  void add(std::pair<int, int> cell, double square) {
    auto& [count, sum] = cells_[cell];
    ++count, sum += square;
  }
  double mean() const {
    double count = 0.0, sum = 0.0;
    for (const auto& [cell, its] : cells_) count += its.first, sum += its.second;
    return sum / count;
  }
  double std_error() const {
    double count = 0.0, square = 0.0;
    for (const auto& [cell, its] : cells_)
      count += its.first, square += std::pow(its.second - mean() * its.first, 2);
    return std::sqrt(square) / count;
  }

 private:
  std::map<std::pair<int, int>, std::pair<int, double>> cells_;
};

/// What of the extraction is true.
struct Score {
  int visible = 0, found = 0, readings = 0, wrong = 0, wrong_radius = 0;
  ChiSquare range, bearing;
};

Score score(const World& world, const ScanScene& scene, const SimulatedScans& scans,
            const Extraction& extraction) {
  const Recording& recording = extraction.recording;
  const int repeats = world.timing.repeats;
  std::vector<int> who(recording.landmarks.size(), -1);
  Score out;
  for (std::size_t j = 0; j < who.size(); ++j) {
    double best = 0.3;
    for (std::size_t l = 0; l < world.landmarks.size(); ++l) {
      const Eigen::Vector2d& at = extraction.landmark_positions[j];
      const double off = std::hypot(at.x() - world.landmarks[l].x_m, at.y() - world.landmarks[l].y_m);
      if (off < best) best = off, who[j] = static_cast<int>(l);
    }
    if (who[j] < 0 || std::abs(recording.landmarks[j].radius_m -
                               world.landmarks[static_cast<std::size_t>(who[j])].radius_m) > 0.01)
      ++out.wrong_radius;
  }
  std::set<std::array<int, 3>> named;
  const Readings& readings = recording.readings;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    const int l = who[static_cast<std::size_t>(readings.landmark[i])];
    const auto scan = static_cast<std::size_t>(readings.stop[i] * repeats + readings.repeat[i]);
    const Pose2& pose = scans.truth[scan].sensor;
    ++out.readings;
    if (l < 0) {
      ++out.wrong;
      continue;
    }
    const world::Cylinder& cylinder = world.landmarks[static_cast<std::size_t>(l)];
    const double dx = cylinder.x_m - pose.x_m, dy = cylinder.y_m - pose.y_m;
    const double range_error = readings.range_m[i] - (std::hypot(dx, dy) - cylinder.radius_m);
    const double bearing_error = wrap_angle(readings.bearing_rad[i] - std::atan2(dy, dx) + pose.heading_rad);
    if (std::abs(range_error) > 0.2 || std::abs(bearing_error) > 0.1) {
      ++out.wrong;
      continue;
    }
    named.insert({readings.stop[i], readings.repeat[i], l});
    const std::pair<int, int> cell{readings.stop[i], l};
    out.range.add(cell, std::pow(range_error / readings.covariates.at("range_sd_m")[i], 2));
    out.bearing.add(cell, std::pow(bearing_error / readings.covariates.at("bearing_sd_rad")[i], 2));
  }
  for (std::size_t s = 0; s < scans.truth.size(); ++s)
    for (int l = 0; l < static_cast<int>(world.landmarks.size()); ++l) {
      const world::Cylinder& cylinder = world.landmarks[static_cast<std::size_t>(l)];
      const Pose2& pose = scans.truth[s].sensor;
      const auto& targets = scans.truth[s].target;
      const auto hits = std::count(targets.begin(), targets.end(), l);
      const double axis = std::hypot(cylinder.x_m - pose.x_m, cylinder.y_m - pose.y_m);
      const double whole = 2.0 * std::asin(cylinder.radius_m / axis) / scene.step_rad;
      if (hits < 4 || static_cast<double>(hits) < whole - 1.0)
        continue;  // visible: whole, four hits at least
      ++out.visible;
      out.found += named.count({static_cast<int>(s) / repeats, static_cast<int>(s) % repeats, l}) > 0;
    }
  return out;
}

void expect_good(const Score& score) {
  std::cout << fmt::format(
      "{} of {} visible cylinders found, {} of {} labels wrong; chi^2 per reading: range {:.3f} +- {:.3f}, bearing {:.3f} +- {:.3f}\n",
      score.found, score.visible, score.wrong, score.readings, score.range.mean(), score.range.std_error(),
      score.bearing.mean(), score.bearing.std_error());
  EXPECT_GT(score.visible, 500);
  EXPECT_GT(score.found, 0.99 * score.visible);
  EXPECT_LT(score.wrong, 0.001 * score.readings + 0.5);
  EXPECT_EQ(score.wrong_radius, 0);
  for (const ChiSquare& chi : {score.range, score.bearing}) {
    EXPECT_LT(chi.std_error(), 0.1);
    EXPECT_LT(std::abs(chi.mean() - 1.0),
              std::min(0.2, 3.0 * chi.std_error()));  // ten of these: one in 37 by chance
  }
}

struct Layout {
  bool turning;
  double speckle, step_rad;
};

class SyntheticScans : public ::testing::TestWithParam<Layout> {};

TEST_P(SyntheticScans, AreDetectedLabelledAndMeasured) {
  const Layout& one = GetParam();
  const World world =
      ideal(one.turning ? world::make_turning_design() : world::make_line_design(), one.speckle);
  const ScanScene scene = room(one.step_rad);
  const SimulatedScans scans = simulate_scans(
      world, scene,
      seed_from("SyntheticScans", {one.turning, static_cast<std::uint64_t>(1e4 * one.speckle)}));
  const ExtractOptions options =
      options_for(world, one.turning ? std::vector<double>{0.04, 0.08, 0.12} : std::vector<double>{0.12});
  const Extraction extraction = extract_recording({scans.log}, world.robot.stops, options);
  EXPECT_EQ(extraction.split, StopSplit::label);
  EXPECT_FALSE(extraction.runs_clockwise);
  EXPECT_NEAR(extraction.noise.quadratic_per_m, one.speckle, 0.1 * one.speckle + 2e-4);
  expect_good(score(world, scene, scans, extraction));
}

INSTANTIATE_TEST_SUITE_P(Designs, SyntheticScans,
                         ::testing::Values(Layout{false, 0.001, 0.00872664626},
                                           Layout{false, 0.004, 0.00872664626},
                                           Layout{true, 0.001, 0.00872664626},
                                           Layout{true, 0.004, 0.00872664626},
                                           Layout{false, 0.002, 0.01745329252}));

TEST(Extract, EstimatesRadiiOfItsOwn) {
  const World world = ideal(world::make_turning_design(), 0.001);
  const ScanScene scene = room(0.0043633231);
  const SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Radii"));
  const Extraction extraction = extract_recording({scans.log}, world.robot.stops, options_for(world, {}));
  const Score result = score(world, scene, scans, extraction);
  EXPECT_EQ(result.wrong_radius, 0);
  EXPECT_LT(result.wrong, 0.001 * result.readings + 0.5);
  EXPECT_GT(result.found,
            0.75 * result.visible);  // a radius needs curvature that shows: the farthest are not taken
}

TEST(Extract, SplitsALogWhereTheRobotStands) {
  World world = ideal(world::make_line_design(), 0.0005);
  world.robot.stops.resize(6);
  ScanScene scene = room(0.00872664626);
  scene.moving_scans = 7, scene.label_stops = false;
  const SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Stands"));
  const Extraction extraction = extract_recording({scans.log}, world.robot.stops, options_for(world, {0.12}));
  EXPECT_EQ(extraction.split, StopSplit::standing);
  EXPECT_EQ(extraction.recording.stops.size(), 6u);
  // Of the 35 scans on the way those within three centimetres of a stop, about two at each end, may count as standing.
  EXPECT_GE(extraction.scans.at("moving"), 15);
  EXPECT_LE(extraction.scans.at("moving"), 36);
  EXPECT_EQ(extraction.recording.landmarks.size(), 5u);
  // A stops file that lists another number of stops is wrong input, and says both numbers.
  world.robot.stops.pop_back();
  try {
    extract_recording({scans.log}, world.robot.stops, options_for(world, {0.12}));
    FAIL() << "accepted";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(),
                ::testing::AllOf(::testing::HasSubstr("6 stands"), ::testing::HasSubstr("5 stops")));
  }
}

TEST(Extract, FlatPanelsOfACylindersWidthAndWallsAreNoCylinders) {
  World world = ideal(world::make_line_design(), 0.001);
  world.landmarks.clear();
  world.robot.stops.resize(5);
  ScanScene scene = room(0.00436332313);
  for (int k = 0; k < 8; ++k) {  // panels 24 cm wide that face the path
    const double x = -1.0 + 0.7 * k, y = k % 2 == 0 ? 1.2 : -1.3;
    scene.walls.push_back({x, y, x + 0.24, y});
  }
  const SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Panels"));
  const Extraction extraction = extract_recording({scans.log}, world.robot.stops, options_for(world, {0.12}));
  EXPECT_TRUE(extraction.recording.landmarks.empty());
  EXPECT_GT(extraction.segments.at("wall"), 0);
  const Extraction free = extract_recording({scans.log}, world.robot.stops, options_for(world, {}));
  EXPECT_TRUE(free.recording.landmarks.empty());
}

TEST(Extract, BoxesOfACylindersWidthAreNoCylinders) {
  World world = ideal(world::make_line_design(), 0.001);
  world.landmarks.clear();
  ScanScene scene = room(0.00436332313);
  for (int k = 0; k < 6; ++k) {  // square, 17 to 24 cm as seen, turned by 0 to 75 degrees
    const double x = -0.8 + 0.9 * k, y = k % 2 == 0 ? 1.2 : -1.3, turn = k * std::numbers::pi / 12.0;
    std::array<Eigen::Vector2d, 5> corner;
    for (std::size_t i = 0; i < corner.size(); ++i) {
      const double angle = turn + 0.5 * std::numbers::pi * static_cast<double>(i);
      corner[i] = {x + 0.12 * std::cos(angle), y + 0.12 * std::sin(angle)};
    }
    for (std::size_t i = 0; i + 1 < corner.size(); ++i)
      scene.walls.push_back({corner[i].x(), corner[i].y(), corner[i + 1].x(), corner[i + 1].y()});
  }
  const SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Boxes"));
  for (const double radius : {0.08, 0.1, 0.12}) {
    const Extraction extraction =
        extract_recording({scans.log}, world.robot.stops, options_for(world, {radius}));
    EXPECT_TRUE(extraction.recording.landmarks.empty()) << radius;
  }
}

TEST(Extract, MixedPixelsAndLostBeamsAreCountedAndDoNotBias) {
  World world = ideal(world::make_line_design(), 0.001);
  world.robot.stops.resize(8);
  ScanScene scene = room(0.00436332313);
  scene.spot_radius_m = 0.004, scene.lost_share = 0.01;
  const SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Mixed"));
  const Extraction extraction = extract_recording({scans.log}, world.robot.stops, options_for(world, {0.12}));
  const Score result = score(world, scene, scans, extraction);
  EXPECT_GT(extraction.beams.at("dropped at a cylinder's edge"), 0);
  EXPECT_GT(extraction.beams.at("no return"), 0);
  EXPECT_EQ(result.wrong, 0);
  EXPECT_GT(result.found, 0.97 * result.visible);
  EXPECT_LT(result.range.mean(), 1.5);
}

TEST(Extract, TheArcsPointIsAChoiceAndAnOffset) {
  World world = ideal(world::make_line_design(), 0.0005);
  world.robot.stops.resize(6);
  const ScanScene scene = room(0.00436332313);
  const SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Arc"));
  ExtractOptions options = options_for(world, {0.12});
  const Extraction nearest = extract_recording({scans.log}, world.robot.stops, options);
  options.arc = ArcRule::mean;
  const Extraction mean = extract_recording({scans.log}, world.robot.stops, options);
  ASSERT_EQ(nearest.recording.readings.size(), mean.recording.readings.size());
  double kappa = 0.0;
  for (std::size_t i = 0; i < mean.recording.readings.size(); ++i)
    kappa += (mean.recording.readings.range_m[i] - nearest.recording.readings.range_m[i]) / 0.12;
  // Mean depth of the inner 90 % of the arc, parallel beams: 1 - (asin(.9) + .9 sqrt(1 - .81)) / 1.8 = 0.160; less
  // nearby.
  EXPECT_NEAR(kappa / static_cast<double>(mean.recording.readings.size()), 0.15, 0.03);
}

TEST(Extract, ClockwiseBearingsAreNoticed) {
  World world = ideal(world::make_turning_design(), 0.001);
  const ScanScene scene = room(0.00872664626);
  SimulatedScans scans = simulate_scans(world, scene, seed_from("Extract.Clockwise"));
  for (Scan& scan : scans.log.scans) {
    std::reverse(scan.range_m.begin(), scan.range_m.end());
    std::reverse(scan.bearing_rad.begin(), scan.bearing_rad.end());
    for (double& bearing : scan.bearing_rad) bearing = -bearing;
  }
  ExtractOptions options = options_for(world, {0.04, 0.08, 0.12});
  EXPECT_TRUE(extract_recording({scans.log}, world.robot.stops, options).runs_clockwise);
  options.clockwise = true;
  const Extraction turned = extract_recording({scans.log}, world.robot.stops, options);
  EXPECT_FALSE(turned.runs_clockwise);
  EXPECT_EQ(turned.recording.landmarks.size(), 6u);
}

// Landmarks in mirror pairs about the path, stops off by three standard deviations: a reflection would fit the ranges.
TEST(Association, DoesNotTakeAMirroredArrangement) {
  const std::vector<Eigen::Vector2d> map{{1.0, 0.8},  {1.0, -0.8}, {2.2, 1.1},
                                         {2.2, -1.1}, {3.1, 0.7},  {3.1, -0.7}};
  Random random(seed_from("Association.Mirror"));
  std::vector<Pose2> commanded;
  std::vector<Sighting> sightings;
  std::vector<int> truth;
  for (int k = 0; k < 12; ++k) {
    commanded.push_back({0.3 * k, 0.0, 0.0});
    const Pose2 pose{0.3 * k + 0.03 * random.normal(), 0.09 * random.normal(), 0.06 * random.normal()};
    for (int l = 0; l < 6; ++l) {
      if (l % 2 == 1 && k < 6) continue;  // for half of the path one side alone is seen
      const Eigen::Vector2d v = map[static_cast<std::size_t>(l)] - Eigen::Vector2d(pose.x_m, pose.y_m);
      sightings.push_back(
          {k, 1.02 * v.norm(), wrap_angle(std::atan2(v.y(), v.x()) - pose.heading_rad), 0.005, 0.005});
      truth.push_back(l);
    }
  }
  AssociationOptions options;
  options.sigma_xy_m = 0.09, options.sigma_heading_rad = 0.06;
  options.map = map;
  EXPECT_EQ(associate(commanded, sightings, options).landmark, truth);
  options.map.clear();
  const Association grown = associate(commanded, sightings, options);
  ASSERT_EQ(grown.landmarks.size(), 6u);
  for (std::size_t i = 0; i < truth.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      EXPECT_EQ(grown.landmark[i] == grown.landmark[j], truth[i] == truth[j]) << i << " " << j;
}

TEST(Assignment, TakesTheLeastSumAndLeavesRowsAlone) {
  Eigen::MatrixXd cost(3, 3);
  cost << 1, 2, 9, 1.5, 9, 9, 9, 9, 20;
  // Greedy would give row 0 column 0; the least sum is 2 (row 0, column 1) + 1.5 (row 1, column 0); row 2 stays alone
  // at 8.
  EXPECT_THAT(assign(cost, 8.0), ::testing::ElementsAre(1, 0, -1));
  EXPECT_THAT(assign(Eigen::MatrixXd(2, 0), 1.0), ::testing::ElementsAre(-1, -1));
  cost.setConstant(std::numeric_limits<double>::infinity());
  EXPECT_THAT(assign(cost, 5.0), ::testing::ElementsAre(-1, -1, -1));
}

}  // namespace
}  // namespace rangecal
