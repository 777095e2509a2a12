// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/bookkeeping.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "rangecal/core/random.hpp"
#include "solvers/diagnosis/state_of_pairs.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

/// Ten stops on the x axis, two landmarks, eight readings of each, distances 1.4 to 6.3 m; `lost(stop,
/// landmark)` of them are missing.
template <typename Lost>
Rows rows_with_gaps(const Lost& lost,
                    const std::array<Eigen::Vector2d, 2>& axes = {Eigen::Vector2d(-1.0, 1.0),
                                                                  Eigen::Vector2d(6.2, -1.0)},
                    double radius_m = 0.0) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.landmarks = {{"a", radius_m, {}}, {"b", radius_m, {}}};
  Random random(seed_from("rows_with_gaps", {1}));
  for (int k = 0; k < 10; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = {0.5 * k, 0.0, 0.0};
    stop.sigma_xy_m = 0.01;
    recording.stops.push_back(stop);
    for (std::size_t l = 0; l < axes.size(); ++l)
      for (int j = 0; j < 8 - lost(k, l); ++j) {
        const Eigen::Vector2d v = axes[l] - Eigen::Vector2d(0.5 * k, 0.0);
        const double range = v.norm() - radius_m + random.normal(0.0, 1e-3);
        testing::add_reading(recording, k, static_cast<int>(l), j, range,
                             std::atan2(v.y(), v.x()) + random.normal(0.0, 1e-3));
      }
  }
  return make_rows({&recording, 1});
}

bool names_dropout(const Rows& rows) {
  const Bookkeeping found = find_grids_and_gaps(rows);
  for (const ActiveEffect& active : found.model)
    if (active.effect->info().id == "dropout") return true;
  return false;
}

TEST(Gaps, BeyondADistanceAreDropout) {
  // The farthest cells: b from stops 0 and 1 (6.28 and 5.79 m), a from stop 9 (5.59 m); next b from stop 2
  // (5.30 m).
  const Bookkeeping found = find_grids_and_gaps(
      rows_with_gaps([](int k, int l) { return (l == 1 && k < 2) || (l == 0 && k == 9) ? 5 : 0; }));
  ASSERT_EQ(found.model.size(), 1u);
  EXPECT_EQ(found.model[0].effect->info().id, "dropout");
  ASSERT_EQ(found.findings.size(), 1u);
  EXPECT_NEAR(*found.findings[0].from, 5.59, 0.01);
  EXPECT_NEAR(found.findings[0].size, 15.0 / 160.0, 1e-12);
  // Three cells of twenty lie farthest by chance in 1 of C(20, 3) = 1140 cases.
  EXPECT_NEAR(found.findings[0].log_p, -std::log(1140.0), 1e-9);
}

TEST(Gaps, CloseToTheSensorsStatedLimitAreItsOwn) {
  // The reader drops what lies beyond range_max_m; what is left of the cells there is no dropout of the physics.
  Rows rows = rows_with_gaps([](int k, int l) { return (l == 1 && k < 2) || (l == 0 && k == 9) ? 5 : 0; });
  EXPECT_TRUE(names_dropout(rows));
  rows.range_max_m = 6.0;
  EXPECT_FALSE(names_dropout(rows));
}

TEST(Gaps, BehindAnotherLandmarkAreNoDropout) {
  // a stands a metre before b, on the line to it from the start: from the stops 0 to 2, the farthest from b, their discs of
  // 15 cm overlap (half-widths 0.030 + 0.025 rad at 5 and 6.1 m, 0 to 0.017 rad apart), from stop 6 on they do not.
  const std::array<Eigen::Vector2d, 2> axes{Eigen::Vector2d(4.98, -0.8), Eigen::Vector2d(6.2, -1.0)};
  const auto behind = [](int k, int l) { return l == 1 && k < 3 ? 8 : 0; };
  EXPECT_FALSE(names_dropout(rows_with_gaps(behind, axes, 0.15)));
  EXPECT_TRUE(names_dropout(rows_with_gaps(behind, axes))) << "points hide nothing";
}

TEST(Gaps, CellsThatAreMissingAltogetherCount) {
  // The same three cells without a single reading: where they would lie follows from the others.
  const auto far = [](int k, int l) { return (l == 1 && k < 2) || (l == 0 && k == 9) ? 8 : 0; };
  const Bookkeeping found = find_grids_and_gaps(rows_with_gaps(far));
  ASSERT_EQ(found.model.size(), 1u);
  EXPECT_EQ(found.model[0].effect->info().id, "dropout");
  EXPECT_NEAR(*found.findings[0].from, 5.59, 0.05);
  EXPECT_NEAR(found.findings[0].size, 24.0 / 160.0, 1e-12);
  EXPECT_NEAR(found.findings[0].log_p, -std::log(1140.0), 1e-9);
  // Where stops see few landmarks anyway, what they do not see says nothing.
  EXPECT_FALSE(names_dropout(
      rows_with_gaps([](int k, int l) { return (k + l) % 3 == 0 || (l == 1 && k < 3) ? 8 : 0; })));
}

TEST(Gaps, FarCellsThatLackMoreWhereAllLackSomeAreLeftAlone) {
  // Every cell but one far one has a gap: where gaps lie says nothing.
  EXPECT_FALSE(names_dropout(rows_with_gaps([](int k, int l) {
    if (l == 0 && k == 8) return 0;
    return (l == 1 && k < 3) || (l == 0 && k == 9) ? 6 : 1;
  })));
}

TEST(Gaps, OfOneLandmarkInTheMiddleAreSomebodyInFrontOfIt) {
  EXPECT_FALSE(names_dropout(rows_with_gaps([](int k, int l) { return l == 0 && k == 4 ? 7 : 0; })));
}

TEST(Gaps, OfTheFarthestCellAloneMayBeChance) {
  // One cell of twenty: by chance 1 in 20 lies farthest.
  EXPECT_FALSE(names_dropout(rows_with_gaps([](int k, int l) { return l == 1 && k == 0 ? 7 : 0; })));
}

TEST(Gaps, NearbyAreNoDropout) {
  EXPECT_FALSE(names_dropout(rows_with_gaps([](int k, int l) { return l == 0 && k < 3 ? 5 : 0; })));
}

TEST(Gaps, StopsOfFewerSweepsAreNoDropout) {
  // Both landmarks lie behind the start: the last four stops are the farthest from either.
  EXPECT_FALSE(names_dropout(rows_with_gaps([](int k, int) { return k > 5 ? 4 : 0; },
                                            {Eigen::Vector2d(-1.0, 1.0), Eigen::Vector2d(-1.0, -1.5)})));
}

TEST(Gaps, EverywhereAreNoDropout) {
  EXPECT_FALSE(names_dropout(rows_with_gaps([](int k, int l) { return (k + l) % 2; })));
}

/// Ten stops along the x axis, two landmarks, three readings of each; `rounded` makes of a range what the sensor says. Bearings lie on a
/// grid of that step and 1 mrad, or on none.
template <typename Rounded>
Bookkeeping found_in_few_repeats(const Rounded& rounded, double bearing_step_rad = 0.0, int stops = 10,
                                 int repeats = 3) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.landmarks = {{"a", 0.0, {}}, {"b", 0.0, {}}};
  const std::array<Eigen::Vector2d, 2> axes{Eigen::Vector2d(-1.0, 1.0), Eigen::Vector2d(6.2, -1.0)};
  Random random(seed_from("found_in_few_repeats", {1}));
  for (int k = 0; k < stops; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = {5.0 * k / stops, 0.0, 0.0};
    stop.sigma_xy_m = 0.01;
    recording.stops.push_back(stop);
    for (int l = 0; l < 2; ++l)
      for (int j = 0; j < repeats; ++j) {
        const Eigen::Vector2d v = axes[static_cast<std::size_t>(l)] - Eigen::Vector2d(5.0 * k / stops, 0.0);
        const double range = v.norm() * (1.0 + random.normal(0.0, 1e-2));
        double bearing = std::atan2(v.y(), v.x()) + random.normal(0.0, 1e-3);
        if (bearing_step_rad > 0.0)
          bearing = 1e-3 + bearing_step_rad * std::round((bearing - 1e-3) / bearing_step_rad);
        testing::add_reading(recording, k, l, j, rounded(range), bearing);
      }
  }
  return find_grids_and_gaps(make_rows({&recording, 1}));
}

TEST(Grids, OfFewRepeatsAreSeenByAllReadingsTogether) {
  // Pixels of a spot: 1/r = 0.003 (n + 0.3), so that no reading is a multiple of a step; written to 0.1 mm.
  const Bookkeeping found = found_in_few_repeats([](double range) {
    const double reading = 1.0 / (0.003 * (std::round(1.0 / range / 0.003 - 0.3) + 0.3));
    return 1e-4 * std::round(1e4 * reading);
  });
  ASSERT_EQ(found.model.size(), 1u);
  EXPECT_EQ(found.model[0].effect->info().id, "quantisation");
  EXPECT_NEAR(found.model[0].parameters[0], 0.003, 1e-5);
  EXPECT_EQ(found.model[0].parameters[1], 0.0);
}

TEST(Grids, OfFewRepeatsOfBearings) {
  const auto as_it_is = [](double range) { return range; };
  const Bookkeeping found = found_in_few_repeats(as_it_is, 0.002);
  ASSERT_EQ(found.model.size(), 1u);
  EXPECT_EQ(found.model[0].effect->info().id, "bearing_quantisation");
  EXPECT_NEAR(found.model[0].parameters[0], 0.002, 1e-9);
}

TEST(Grids, OfBearingsThatNeverRepeatAreNotJudged) {
  // Against what spread?
  EXPECT_TRUE(found_in_few_repeats([](double range) { return range; }, 0.002, 60, 1).model.empty());
}

TEST(Grids, AreComparedWithTheSpreadThatEffectsOfTheNoiseLeave) {
  // Known distances read once, to 1 mm, with noise of 20 mm, of which the fit has 0.2 mm in the curve's own law.
  Recording recording;
  recording.kind = RecordingKind::pairs;
  Random random(seed_from("Grids.SpreadOfEffects"));
  for (int i = 0; i < 300; ++i) {
    const double d = 1.0 + 0.01 * i + 1e-4 * random.normal();
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(1e-3 * std::round(1e3 * (d + random.normal(0.0, 0.02))));
    recording.pairs.row.push_back(i + 2);
  }
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 1});
  Fit fit;
  fit.state = testing::state_of_pairs(rows, Eigen::Vector2d(0.0, 1.0), NoiseLaw::constant, 0.0002);
  Bookkeeping known;
  EXPECT_TRUE(add_grid_beside(rows, fit, known));
  known = {};
  const double factor = std::log(1e4);  // of the variance
  fit.model = {{find_effect("noise_law"), Eigen::Vector3d(factor, factor, 1.0)}};
  EXPECT_FALSE(add_grid_beside(rows, fit, known));
  EXPECT_TRUE(known.model.empty());
}

TEST(Grids, OfFewRepeatsInMetres) {
  const Bookkeeping found =
      found_in_few_repeats([](double range) { return 0.01 * std::round(100.0 * range); });
  ASSERT_EQ(found.model.size(), 1u);
  EXPECT_NEAR(found.model[0].parameters[1], 0.01, 1e-9);
  // Digits that are far below the noise are no grid, nor is what lies on none.
  EXPECT_TRUE(
      found_in_few_repeats([](double range) { return 1e-4 * std::round(1e4 * range); }).model.empty());
  EXPECT_TRUE(found_in_few_repeats([](double range) { return range; }).model.empty());
}

}  // namespace
}  // namespace rangecal::diagnosis
