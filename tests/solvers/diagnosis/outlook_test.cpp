// SPDX-License-Identifier: BSD-3-Clause
// A usual design: 11 stops 0.3 m apart, five landmarks of 12 cm at 0.9 to 3.4 m, 20 repeats, sigma_r = 2 mm + 3 mm d^2,
// sigma_b = 0.5 degrees, stops to 1 cm, headings to 0.3 degrees.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "diagnosis/extended_design.hpp"
#include "diagnosis/unseen.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double degree = std::numbers::pi / 180.0;

struct TableDesign {
  Rows rows;
  JointState state;

  TableDesign() {
    Recording recording;
    state.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
    state.noise.law = NoiseLaw::polynomial;
    state.noise.parameters = Eigen::Vector3d(0.002, 0.0, 0.003);
    state.sigma_theta_rad = 0.5 * degree;
    state.landmarks = {{-0.6, 1.1}, {0.8, -1.0}, {1.7, 1.4}, {2.9, -1.2}, {3.9, 0.9}};
    for (int l = 0; l < 5; ++l) recording.landmarks.push_back({std::to_string(l), 0.12, {}});
    recording.sigma_heading_rad = 0.3 * degree;
    for (int k = 0; k < 11; ++k) {
      Stop stop;
      stop.label = std::to_string(k);
      stop.commanded = {0.3 * k, 0.0, 0.0};
      recording.stops.push_back(stop);
      state.stops.push_back(stop.commanded);
      for (int l = 0; l < 5; ++l)
        for (int j = 0; j < 20; ++j) {
          const Eigen::Vector2d line =
              state.landmarks[static_cast<std::size_t>(l)] - Eigen::Vector2d(0.3 * k, 0.0);
          recording.readings.stop.push_back(k);
          recording.readings.landmark.push_back(l);
          recording.readings.repeat.push_back(j);
          recording.readings.time_s.push_back(30.0 * k + j);
          recording.readings.range_m.push_back(line.norm());
          recording.readings.bearing_rad.push_back(std::atan2(line.y(), line.x()));
        }
    }
    rows = make_rows({&recording, 1});
  }
};

double visibility(const Space& space, const char* id) {
  return std::sqrt(typical_effect(space, *find_effect(id))->noncentrality);
}

double harm_mm(const Space& space, const char* id) {
  return 1e3 * harm_of(space, *typical_effect(space, *find_effect(id)));
}

TEST(Outlook, AbsorbedEffectsLeaveNothingAndCostWhatTheTableSays) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  for (const char* id : {"range_offset", "radius_scale", "arc_definition", "odometry_scale", "lever_arm",
                         "range_scale", "laser_pointing"})
    EXPECT_LT(visibility(space, id), 0.2) << id;
  EXPECT_NEAR(harm_mm(space, "range_offset"), 5.0, 0.75);    // 5 mm
  EXPECT_NEAR(harm_mm(space, "radius_scale"), 6.0, 0.9);     // 5 % of 12 cm
  EXPECT_NEAR(harm_mm(space, "odometry_scale"), 26.0, 3.9);  // 1 % of the axis distances
  EXPECT_NEAR(harm_mm(space, "arc_definition"), 24.0, 3.6);  // 0.2 of 12 cm; the table's 26 is 0.215 of it
  EXPECT_LT(harm_mm(space, "range_scale") + harm_mm(space, "laser_pointing") + harm_mm(space, "lever_arm"),
            0.1);
}

TEST(Outlook, VisibleEffectsShowAsInTheTable) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  EXPECT_NEAR(visibility(space, "bearing_offset"), 4.9,
              0.74);  // a constant: does not depend on where the landmarks are
  EXPECT_NEAR(visibility(space, "beam_offset"), 11.0,
              5.5);  // these depend on the directions, which the table leaves open
  EXPECT_NEAR(visibility(space, "path_curvature"), 12.0, 6.0);
  EXPECT_NEAR(visibility(space, "bearing_scale"), 17.0, 8.5);
}

TEST(Outlook, ExactTwinsComeOut) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  const auto twins = find_twins(space, catalogue_of(space));
  const auto listed = [&](const char* a, const char* b) {
    return std::any_of(twins.begin(), twins.end(), [&](const auto& set) {
      return std::find(set.begin(), set.end(), a) != set.end() &&
             std::find(set.begin(), set.end(), b) != set.end();
    });
  };
  EXPECT_TRUE(listed("range_offset", "alpha_0"));
  EXPECT_TRUE(listed("bearing_offset", "heading_zero"));
  EXPECT_TRUE(listed("bearing_drift", "heading_drift"));
  EXPECT_TRUE(listed("radius_scale", "arc_definition"));
  EXPECT_TRUE(listed("odometry_scale", "alpha_1"));
  EXPECT_TRUE(listed("lever_arm", "landmarks"));
  EXPECT_FALSE(listed("bearing_drift", "bearing_offset"));
}

TEST(Outlook, TurningShowsLeverArmAndTapeShowsPathScale) {
  const TableDesign design;
  const auto in = [&](const char* code, const char* id) {
    const ExtendedDesign extended = extend(design.rows, design.state, code);
    const Space space(extended.rows, {}, extended.state);
    return visibility(space, id);
  };
  EXPECT_NEAR(in("E1", "lever_arm"), 118.0, 0.25 * 118.0);  // table: 118, along x or y of its landmarks
  EXPECT_NEAR(in("E3", "odometry_scale"), 3.1, 2.0);        // table: 3.1; grows with the taped length
  EXPECT_GT(in("E4", "arc_definition"), 3.0);               // table: 5.7
  EXPECT_LT(in("E1", "range_offset"), 0.05);                // exact in every design
  EXPECT_LT(in("E2", "odometry_scale"), 0.2);
}

TEST(Outlook, DetectionThresholdIsThatOfOneTestAtTwoPercent) {
  // One question: z = 2.326 (two-sided 2 %), (2.326 + 0.842)^2 = 10.04.
  EXPECT_NEAR(detection_threshold(0.02, 1.0), 10.04, 0.01);
  EXPECT_NEAR(detection_power(detection_threshold(0.02, 400.0), 0.02, 400.0), 0.8, 1e-6);
}

TEST(Outlook, WhatTheRepeatsShowIsNoTwinOfAConstant) {
  const TableDesign design;
  const Space space(design.rows, {}, design.state);
  for (const auto& set : find_twins(space, catalogue_of(space)))
    EXPECT_FALSE(std::count(set.begin(), set.end(), "heading_zero") &&
                 std::count(set.begin(), set.end(), "settling"));
}

TEST(Outlook, ADropoutShowsBelowALimitNotAboveIt) {
  const TableDesign design;  // to 3.4 m
  const Space space(design.rows, {}, design.state);
  const std::optional<TypicalEffect> typical = typical_effect(space, *find_effect("dropout"));
  ASSERT_TRUE(typical);
  Rates rates;
  for (const Unseen& unseen : find_unseen(space, {*typical}, 0.02, rates)) {
    ASSERT_TRUE(unseen.detectable);
    EXPECT_LT(*unseen.detectable, unseen.typical.at("limit_m"));
  }
}

}  // namespace
}  // namespace rangecal::diagnosis
