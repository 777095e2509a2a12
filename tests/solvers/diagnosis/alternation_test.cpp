// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/alternation.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

/// Three stops on the x axis, two landmarks, five readings of each: y = d + c for d < limit, else d, hardly
/// any noise.
Recording recording_with_step(double limit, double offset) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  const Eigen::Vector2d axes[] = {{1.0, 1.0}, {3.0, -1.0}};
  testing::add_landmarks(recording, 2);
  Random random(seed_from("recording_with_step", {1}));
  for (int k = 0; k < 3; ++k) {
    testing::add_stop(recording, {0.5 * k, 0.0, 0.0}, 0.01);
    for (int l = 0; l < 2; ++l)
      for (int j = 0; j < 5; ++j) {
        const Eigen::Vector2d v = axes[l] - Eigen::Vector2d(0.5 * k, 0.0);
        const double d = v.norm();
        const double range = d + (d < limit ? offset : 0.0) + random.normal(0.0, 1e-4);
        testing::add_reading(recording, k, l, j, range, std::atan2(v.y(), v.x()) + random.normal(0.0, 1e-4));
      }
  }
  return recording;
}

JointState truth() {
  JointState state;
  state.alpha = Eigen::Vector2d(0.0, 1.0);
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters = Eigen::VectorXd::Constant(1, 1e-4);
  state.sigma_theta_rad = 1e-4;
  state.landmarks = {{1.0, 1.0}, {3.0, -1.0}};
  for (int k = 0; k < 3; ++k) state.stops.push_back({0.5 * k, 0.0, 0.0});
  return state;
}

TEST(Sides, ACellThatReadsOffTheStepIsMovedOverTheSwitchingDistance) {
  // Stop 0 sees landmark a at sqrt(2) = 1.414214 m. It switches at 1.41425 m: the reading has the step of 20
  // mm. A stop estimated 0.1 mm too far back puts the cell at 1.414284 m, beyond: 20 mm off with a spread of
  // 0.1 mm. Ten readings of that spread leave the stop sqrt(2 / 10) 0.1 mm = 0.045 mm, so that the side is
  // open.
  const double limit = 1.41425, offset = 0.02;
  const Recording recording = recording_with_step(limit, offset);
  const Rows rows = make_rows(std::span<const Recording>(&recording, 1));
  const Effect* effect = find_effect("near_regime");
  const Model model{{effect, Eigen::Vector3d(offset, 0.0, limit)}};
  JointState state = truth();
  state.stops[0].x_m -= 1e-4;
  ASSERT_GT(cell_geometry(rows, state).d[0], limit);
  Alternation alternation(model);
  alternation.begin(rows, model, state);
  EXPECT_LT(cell_geometry(rows, state).d[0], limit);
  EXPECT_NEAR(cell_geometry(rows, state).d[0], limit, 1e-5);  // just over it
  // Another stop stays where it was.
  EXPECT_EQ(state.stops[1].x_m, 0.5);
}

TEST(Sides, AMoveBackOverTheDistanceCostsItsSquare) {
  const double limit = 1.416;
  const Recording recording = recording_with_step(limit, 0.02);
  const Rows rows = make_rows(std::span<const Recording>(&recording, 1));
  const Model model{{find_effect("near_regime"), Eigen::Vector3d(0.02, 0.0, limit)}};
  JointState state = truth();
  Alternation alternation(model);
  alternation.begin(rows, model, state);
  ASSERT_LT(cell_geometry(rows, state).d[0], limit);
  state.stops[0].x_m -= 0.004;  // what a solve that knows nothing of sides may do
  const double over = cell_geometry(rows, state).d[0] - limit;
  double value = 0.0;
  alternation.another(rows, state, value);
  EXPECT_LT(cell_geometry(rows, state).d[0], limit);
  // Information of the stop along a line of sight: the prior's 1e4 and half of ten readings of 0.1 mm, 5e8.
  EXPECT_NEAR(value, 0.5 * over * over * (1e4 + 5e8), 1e-3 * value);
}

TEST(Sides, StopsOfOnePlaceCrossTogether) {
  // Stops 0 and 1 stand at one place and share its error: it is moved once, not once for each of them.
  const double limit = 1.41425, offset = 0.02;
  Recording recording = recording_with_step(limit, offset);
  recording.stops[1].commanded = {0.0, 0.0, 1.0};
  recording.stops[0].place = recording.stops[1].place = "home";
  for (std::size_t i = 0; i < recording.readings.range_m.size(); ++i)
    if (recording.readings.stop[i] == 1) {
      recording.readings.range_m[i] = recording.readings.range_m[i - 10];
      recording.readings.bearing_rad[i] = recording.readings.bearing_rad[i - 10] - 1.0;
    }
  const Rows rows = make_rows(std::span<const Recording>(&recording, 1));
  ASSERT_EQ(rows.problem.stops[0].place, rows.problem.stops[1].place);
  const Model model{{find_effect("near_regime"), Eigen::Vector3d(offset, 0.0, limit)}};
  JointState state = truth();
  state.stops[1] = {0.0, 0.0, 1.0};
  for (int k : {0, 1}) state.stops[k].x_m -= 1e-4;
  Alternation alternation(model);
  alternation.begin(rows, model, state);
  const CellGeometry geometry = cell_geometry(rows, state);
  for (int cell : {0, 2}) {
    EXPECT_LT(geometry.d[cell], limit);
    EXPECT_NEAR(geometry.d[cell], limit, 1e-5);
  }
}

TEST(Sides, AReadingOnItsSideIsSeenNoFartherThanItsEnd) {
  const double limit = 1.416;
  const Recording recording = recording_with_step(limit, 0.02);
  const Rows rows = make_rows(std::span<const Recording>(&recording, 1));
  const Model model{{find_effect("range_offset"), Eigen::VectorXd::Constant(1, 0.01)},
                    {find_effect("near_regime"), Eigen::Vector3d(0.02, 0.0, limit)}};
  JointState state = truth();
  Sides sides;
  sides.take(rows, model, state);
  state.stops[0].x_m -= 0.004;  // its distance to landmark a is 1.4171 m now, over L
  const CellGeometry geometry = cell_geometry(rows, state);
  const ReadingView<double> view = view_of(rows, geometry, 0);
  ASSERT_GT(view.d, limit);
  EXPECT_NEAR(sides.seen_by(1, 0, view).d, limit, 1e-5);
  EXPECT_LT(sides.seen_by(1, 0, view).d, limit);
  EXPECT_EQ(sides.seen_by(0, 0, view).d, view.d);  // which jumps nowhere
  EXPECT_NEAR(working_problem(rows, model, state, &sides).range[0],
              working_problem(rows, model, state).range[0] - 0.02, 1e-12);
}

TEST(Sides, OthersAreThoseThatTheJumpCouldHaveMisplaced) {
  // Distances of landmark a: 1.4142, 1.118, 1.0 m; of b: 3.162, 2.693, 2.236 m. L = 1.41 m may be anywhere
  // between the two nearest, so both are in doubt; the third only where the jump is as large as its distance.
  const Recording recording = recording_with_step(1.41, 0.02);
  const Rows rows = make_rows(std::span<const Recording>(&recording, 1));
  const JointState state = truth();
  const Effect* effect = find_effect("near_regime");
  const auto others = Sides::others(rows, {{effect, Eigen::Vector3d(0.02, 0.0, 1.41)}}, state);
  ASSERT_EQ(others.size(), 2u);
  for (const auto& [model, moved] : others) {
    const double limit = model[0].parameters[2];
    int changed = 0;
    const CellGeometry before = cell_geometry(rows, state), after = cell_geometry(rows, moved);
    for (int c = 0; c < rows.cell_count; ++c) {
      changed += (before.d[c] < 1.41) != (after.d[c] < limit);
      EXPECT_NEAR(after.d[c], before.d[c], 1e-5);  // L moved there; nothing else had to
    }
    EXPECT_EQ(changed, 1);
  }
  EXPECT_EQ(Sides::others(rows, {{effect, Eigen::Vector3d(0.2, 0.0, 1.41)}}, state).size(), 3u);
}

TEST(EffectSlope, AnEffectThatWobblesWithDistanceGivesItsCellsASlope) {
  const Recording recording = recording_with_step(0.0, 0.0);
  const Rows rows = make_rows(std::span<const Recording>(&recording, 1));
  const Effect* effect = find_effect("cyclic_error");
  const auto grid = effect->start_grid(rows.context);
  Eigen::VectorXd p = grid[grid.size() / 2];
  for (std::size_t j = 0; j < effect->info().parameters.size(); ++j)
    if (effect->info().parameters[j].linear) p[static_cast<Eigen::Index>(j)] = 0.05;
  const JointState state = truth();
  const WorkingProblem working = working_problem(rows, {{effect, p}}, state);
  const Cells& cells = working.problem.cells;
  ASSERT_EQ(cells.effect_slope.size(), 6u);
  const CellGeometry geometry = cell_geometry(rows, state);
  for (int c = 0; c < 6; ++c) {
    const auto change = [&](double h) {
      ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[c]));
      view.d += h;
      return effect->reading(view, p.data()).range;
    };
    EXPECT_NEAR(cells.effect_slope[c], (change(1e-6) - change(-1e-6)) / 2e-6,
                1e-3 * (1.0 + std::abs(cells.effect_slope[c])));
    EXPECT_EQ(cells.effect_change(static_cast<std::size_t>(c), geometry.d[c]), 0.0);
  }
  EXPECT_TRUE(working_problem(rows, {}, state).problem.cells.effect_slope.empty());
}

}  // namespace
}  // namespace rangecal::diagnosis
