// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/consensus.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

namespace rangecal {
namespace {

Recording field(std::uint64_t repeat) {
  const Scene scene = load_scene(RANGECAL_SOURCE_DIR "/notebooks_data/scenes/field-layout.yaml");
  return simulate(scene, seed_from("consensus", {repeat}));
}

TEST(Consensus, OfCleanReadingsIsAllOfThem) {
  for (std::uint64_t repeat = 0; repeat < 20; ++repeat) {
    const Recording recording = field(repeat);
    const JointProblem rows = make_joint_problem({&recording, 1}, Grouping::rows);
    const Consensus found = find_consensus(rows);
    EXPECT_EQ(found.left_out, 0) << repeat;
    const JointProblem cells = make_joint_problem({&recording, 1});
    ASSERT_EQ(found.problem.cells.size(), cells.cells.size());
    for (std::size_t i = 0; i < cells.cells.size(); ++i) {
      EXPECT_EQ(found.problem.cells.count[i], cells.cells.count[i]);
      EXPECT_NEAR(found.problem.cells.range_mean[i], cells.cells.range_mean[i], 1e-14);
      EXPECT_NEAR(found.problem.cells.bearing_mean[i], cells.cells.bearing_mean[i], 1e-14);
      EXPECT_NEAR(found.problem.cells.range_mean_square[i], cells.cells.range_mean_square[i], 1e-16);
    }
  }
}

TEST(Consensus, LeavesOutWrongRangesBearingsAndLabelsAndNothingElse) {
  Recording recording = field(100);
  Readings& readings = recording.readings;
  const JointProblem before = make_joint_problem({&recording, 1}, Grouping::rows);
  readings.range_m[3] += 2.0;
  readings.bearing_rad[111] += 1.0;
  const int labelled = readings.landmark[222];
  readings.landmark[222] = (labelled + 1) % static_cast<int>(recording.landmarks.size());
  const JointProblem rows = make_joint_problem({&recording, 1}, Grouping::rows);
  const Consensus found = find_consensus(rows);
  EXPECT_EQ(found.left_out, 3);
  EXPECT_EQ(found.problem.readings, before.readings - 3.0);
  int relabelled = 0;
  for (std::size_t i = 0; i < rows.cells.size(); ++i)
    if (found.fits_landmark[i] >= 0) {
      ++relabelled;
      EXPECT_EQ(found.fits_landmark[i], labelled);
      EXPECT_FALSE(found.kept[i]);
    }
  EXPECT_EQ(relabelled, 1);
}

TEST(Consensus, AWrongBearingInAHundredLeavesTheClosedFormItsLandmarks) {
  Recording recording = field(200);
  const JointProblem clean = make_joint_problem({&recording, 1});
  Random random(seed_from("wrong bearings"));
  for (double& bearing : recording.readings.bearing_rad)
    if (random.uniform() < 0.01) bearing = random.uniform(-3.14, 3.14);
  const JointProblem rows = make_joint_problem({&recording, 1}, Grouping::rows);
  const Consensus found = find_consensus(rows);
  ASSERT_GT(found.left_out, 0);
  ClosedFormOptions options;
  options.order = 2;
  const Calibration robust = closed_form_calibration(found.problem, options),
                    before = closed_form_calibration(clean, options);
  ASSERT_EQ(robust.outcome, Outcome::converged) << robust.reason;
  for (std::size_t l = 0; l < robust.landmarks.size(); ++l) {
    const Eigen::Vector2d moved = robust.landmarks[l].position_m - before.landmarks[l].position_m;
    // One line in a hundred less: by a tenth of the deviation or so.
    EXPECT_LT(moved.norm(), std::sqrt(before.landmarks[l].covariance->trace()));
  }
}

TEST(Consensus, OfPairsKeepsASteepCurveAndLeavesOutGrossReadings) {
  std::vector<double> d, y;
  Random random(seed_from("steep"));
  for (int i = 0; i < 400; ++i) {
    d.push_back(random.uniform(0.2, 4.0));
    y.push_back(0.3 + 0.6 / (d.back() + 0.1) + 0.005 * random.normal());  // a triangulating sensor's volts
  }
  std::vector<char> kept = agreeing_pairs(d, y);
  // A polynomial of order 4 misses by more than noise in places; what is kept spans all distances.
  int near = 0, near_kept = 0;
  for (std::size_t i = 0; i < d.size(); ++i)
    if (d[i] < 0.5) {
      ++near;
      near_kept += kept[i];
    }
  EXPECT_GT(near_kept, near / 2);
  for (std::size_t i = 0; i < d.size(); ++i) y[i] = 0.05 + 0.95 * d[i] + 0.01 * d[i] * d[i] * random.normal();
  kept = agreeing_pairs(d, y);
  EXPECT_EQ(std::count(kept.begin(), kept.end(), 0), 0);
  y[7] += 2.0;
  kept = agreeing_pairs(d, y);
  EXPECT_EQ(kept[7], 0);
  EXPECT_EQ(std::count(kept.begin(), kept.end(), 0), 1);
}

TEST(Consensus, OfNothingIsNothing) {
  EXPECT_EQ(find_consensus(JointProblem{}).left_out, 0);
  EXPECT_TRUE(agreeing_pairs({}, {}).empty());
}

}  // namespace
}  // namespace rangecal
