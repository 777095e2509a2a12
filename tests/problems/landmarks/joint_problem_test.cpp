// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/joint_problem.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// Readings of one landmark from `stops` stops of one place, each with a heading of its own.
Recording one_place(int stops) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "here";
  recording.sigma_xy_m = 0.1;
  recording.sigma_heading_rad = 0.1;
  recording.landmarks.resize(1);
  for (int k = 0; k < stops; ++k) {
    recording.stops.emplace_back().place = "p";
    recording.readings.stop.push_back(k);
    recording.readings.landmark.push_back(0);
    recording.readings.range_m.push_back(1.0 + k);
    recording.readings.bearing_rad.push_back(0.0);
  }
  return recording;
}

TEST(JointProblem, AStopsReadingsBecomeACell) {
  // Ranges 1 and 4 of one landmark from one stop: mean 2.5, mean square deviation 2.25; bearings 3.1 and -3.1
  // lie 2 pi - 6.2 apart across pi: mean pi, mean square deviation (pi - 3.1)^2.
  Recording recording = one_place(1);
  Readings& readings = recording.readings;
  readings.stop.push_back(0);
  readings.landmark.push_back(0);
  readings.range_m.push_back(4.0);
  readings.bearing_rad = {3.1, -3.1};
  const JointProblem problem = make_joint_problem({&recording, 1});
  ASSERT_EQ(problem.cells.size(), 1u);
  EXPECT_EQ(problem.readings, 2.0);
  EXPECT_DOUBLE_EQ(problem.cells.range_mean[0], 2.5);
  EXPECT_DOUBLE_EQ(problem.cells.range_mean_square[0], 2.25);
  EXPECT_NEAR(std::abs(problem.cells.bearing_mean[0]), std::numbers::pi, 1e-12);
  EXPECT_NEAR(problem.cells.bearing_mean_square[0], (std::numbers::pi - 3.1) * (std::numbers::pi - 3.1),
              1e-12);
}

TEST(JointProblem, APlaceOfTooManyStopsIsRefused) {
  // dim = 32 742 + 2: dim (2 dim + 2 + 32) = 2 144 339 072 + 1 113 296 < 2^31; 40 000 stops make 3.2e9.
  const Recording many = one_place(32742), more = one_place(40000);
  EXPECT_EQ(make_joint_problem({&many, 1}).place_count, 1);
  EXPECT_THROW(make_joint_problem({&more, 1}), InputError);
}

}  // namespace
}  // namespace rangecal
