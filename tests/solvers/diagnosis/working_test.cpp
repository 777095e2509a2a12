// SPDX-License-Identifier: BSD-3-Clause
// Derivatives in an effect's parameter and in distance where the effect swings fastest: decimetres away. And readings
// far out under a law with tails.
#include "diagnosis/working.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>
#include <vector>

#include "diagnosis/rows.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

/// Three stops between four poles at 0.15 to 0.6 m, three repeats, every reading exact: f(d) = d.
struct NearScene {
  Recording recording;
  Rows rows;
  JointState truth;

  NearScene() {
    const std::vector<Eigen::Vector2d> axes{{0.15, 0.1}, {0.35, -0.12}, {-0.1, 0.2}, {0.5, 0.3}};
    recording.kind = RecordingKind::landmarks;
    recording.path = "made";
    testing::add_landmarks(recording, axes.size());
    truth.alpha = Eigen::Vector2d(0.0, 1.0);
    truth.noise.law = NoiseLaw::constant;
    truth.noise.parameters = Eigen::VectorXd::Constant(1, 1e-3);
    truth.sigma_theta_rad = 0.01;
    truth.landmarks = axes;
    for (int k = 0; k < 3; ++k) {
      const Pose2 pose{0.03 * k, 0.01 * k, 0.0};
      testing::add_stop(recording, pose, 1e-3);
      truth.stops.push_back(pose);
      for (std::size_t l = 0; l < axes.size(); ++l)
        for (int j = 0; j < 3; ++j) {
          const Eigen::Vector2d v = axes[l] - Eigen::Vector2d(pose.x_m, pose.y_m);
          testing::add_reading(recording, k, static_cast<int>(l), j, v.norm() + 1e-3 * (j - 1),
                               std::atan2(v.y(), v.x()));
        }
    }
    rows = make_rows({&recording, 1});
  }
};

// A pull so small (0.007 px) that it is one sinusoid: the second harmonic is 4e-6 of it.
constexpr double near_cosine = 2e-5, near_sine = -8e-6, near_wavenumber = 1900.0;

ActiveEffect near_locking() {
  return {find_effect("pixel_locking"), Eigen::Vector3d(near_cosine, near_sine, near_wavenumber)};
}

TEST(Working, TheSlopeInAWavenumberIsItsOwnAtDecimetres) {
  // d/dk of d^2 (c cos(k/d) + s sin(k/d)) is d (s cos(k/d) - c sin(k/d)); a step of 0.75 m turns the phase by 5 rad at
  // 0.15 m. The step's own truncation there is (1e-6 k / d)^2 / 6 = 3e-5 of the amplitude.
  const NearScene scene;
  const Projector projector(scene.rows, working_problem(scene.rows, {}, scene.truth), scene.truth);
  const Signature x = effect_signature(scene.rows, projector, near_locking(), 2);
  ASSERT_FALSE(x.within());
  for (int c = 0; c < scene.rows.cell_count; ++c) {
    const double d = projector.geometry().d[static_cast<std::size_t>(c)], phase = near_wavenumber / d;
    const double expected = d * (near_sine * std::cos(phase) - near_cosine * std::sin(phase));
    EXPECT_NEAR(x.range[c], expected, 5e-5 * d * std::hypot(near_cosine, near_sine)) << d;
  }
}

TEST(Working, TheSlopeInDistanceIsThatOfTheFastestSwing) {
  // 2 d (c cos(k/d) + s sin(k/d)) + k (c sin(k/d) - s cos(k/d)): a period is 0.07 mm at 0.15 m.
  const NearScene scene;
  const Cells cells = working_problem(scene.rows, {near_locking()}, scene.truth).problem.cells;
  const CellGeometry geometry = cell_geometry(scene.rows, scene.truth);
  ASSERT_EQ(cells.effect_slope.size(), static_cast<std::size_t>(scene.rows.cell_count));
  for (std::size_t c = 0; c < cells.effect_slope.size(); ++c) {
    const double d = geometry.d[c], phase = near_wavenumber / d;
    const double expected = 2.0 * d * (near_cosine * std::cos(phase) + near_sine * std::sin(phase)) +
                            near_wavenumber * (near_cosine * std::sin(phase) - near_sine * std::cos(phase));
    EXPECT_NEAR(cells.effect_slope[c], expected, 5e-5 * near_wavenumber * std::hypot(near_cosine, near_sine))
        << d;
  }
}

TEST(Working, ACoverTurnsThePullOfTheSpotToo) {
  // The pull's slope in d is up to 0.76, its own: what the cover adds to the range changes by 1 + that.
  const NearScene scene;
  const Model model{{find_effect("pixel_locking"), Eigen::Vector3d(3e-4, -2.6e-4, near_wavenumber)},
                    {find_effect("range_eccentricity"), Eigen::Vector2d(0.004, -0.003)}};
  const Projector projector(scene.rows, working_problem(scene.rows, model, scene.truth), scene.truth);
  const CellGeometry geometry = cell_geometry(scene.rows, scene.truth);
  double most = 0.0;
  for (const int index : {0, 1}) {
    constexpr double step = 1e-7;
    Model up = model, down = model;
    up[1].parameters[index] += step;
    down[1].parameters[index] -= step;
    const Eigen::VectorXd slope =
        (row_changes(scene.rows, geometry, up).range - row_changes(scene.rows, geometry, down).range) /
        (2.0 * step);
    const Signature x = effect_signature(scene.rows, projector, model[1], index);
    for (int c = 0; c < scene.rows.cell_count; ++c) {
      EXPECT_NEAR(x.range[c], slope[scene.rows.cell_begin[c]],
                  2e-3);  // 2 A d of the slope is of the amplitude d^2
      const double bearing = geometry.bearing[static_cast<std::size_t>(c)];
      most = std::max(most, std::abs(x.range[c] - (index == 0 ? std::cos(bearing) : std::sin(bearing))));
    }
  }
  EXPECT_GT(most, 0.3) << "far from what it is alone";
}

TEST(Working, BesideAJumpTheSlopeIsThatOfTheOwnSide) {
  const Effect& effect = *find_effect("near_regime");
  const ActiveEffect active{&effect, Eigen::Vector3d(0.005, 0.1, 0.8)};  // 5 mm and a tenth below 0.8 m
  ReadingView<double> at{};
  at.slope = 1.0;
  for (const double off : {-1e-3, -1e-6, -1e-7, -1e-12, 1e-12, 1e-7, 1e-6, 1e-3}) {
    at.d = at.f = 0.8 + off;
    EXPECT_NEAR(effect_slope_of(active, at), off < 0.0 ? 0.1 : 0.0, 1e-6) << off;
  }
}

TEST(Working, GrossOutliersHaveALikelihood) {
  // 1000 standard deviations off: the plain density of a contaminated normal is 0 / 0 from 58 on at a ratio of 1.5.
  NearScene scene;
  const ActiveEffect tails{find_effect("heavy_tails"), Eigen::Vector2d(0.03, 1.5)};
  const auto constant_of = [&] {
    const Rows rows = make_rows({&scene.recording, 1});
    const WorkingProblem working = working_problem(rows, {tails}, scene.truth);
    for (const double weight : working.problem.cells.range_weight) EXPECT_TRUE(std::isfinite(weight));
    for (const double mean : working.problem.cells.range_mean) EXPECT_TRUE(std::isfinite(mean));
    return working.constant;
  };
  EXPECT_TRUE(std::isfinite(constant_of()));
  for (const double z : {57.0, 59.0, 300.0, 1000.0}) {
    scene.recording.readings.range_m[4] = 0.37 + 1e-3 * z;  // the second pole from the first stop
    EXPECT_TRUE(std::isfinite(constant_of())) << z;
  }
}

TEST(Working, APeriodIsFoundBetweenThePointsOfItsGrid) {
  // 1500 pairs at 0.15 to 1 m; 700.4 lies between the grid's 700.04 and 700.79, and is told to 0.04. The fit stayed on
  // a point of the grid.
  Random random(seed_from("Working.APeriod", {1}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  constexpr double amplitude = 0.001, k = 700.4, phase = 2.0;
  for (int i = 0; i < 1500; ++i) {
    const double d = random.uniform(0.15, 1.0), f = 0.02 + d * (0.98 + 0.01 * d);
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(
        random.normal(f - amplitude * d * d * std::sin(k / d + phase), 5e-4 * f * f));
  }
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.force = {"pixel_locking"};
  const Diagnosis d = diagnose({&recording, 1}, options);
  ASSERT_FALSE(d.explanations.empty());
  const auto estimate_of = [&](const std::string& name) {
    const auto& all = d.explanations[0].parameters;
    const auto found = std::find_if(
        all.begin(), all.end(), [&](const EffectEstimate& e) { return e.name == "pixel_locking." + name; });
    return found == all.end() ? EffectEstimate{} : *found;
  };
  const EffectEstimate period = estimate_of("period_per_m"), turned = estimate_of("phase_rad");
  ASSERT_GT(period.std_dev, 0.0);
  EXPECT_LT(period.std_dev / period.estimate, 2e-4);
  // Five standard deviations: once in two million draws.
  EXPECT_NEAR(period.estimate, 2.0 * std::numbers::pi / k, 5.0 * period.std_dev);
  EXPECT_NEAR(std::remainder(turned.estimate - phase, 2.0 * std::numbers::pi), 0.0, 5.0 * turned.std_dev);
}

/// Of one effect of the catalogue, its linear parameters three times their typical size, the others where its grid starts.
ActiveEffect large(const Effect& effect, const EffectContext& context) {
  ActiveEffect active{&effect, effect.start_grid(context).front()};
  const std::vector<EffectParameter>& parameters = effect.info().parameters;
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    const auto [low, high] = effect.bounds(context, j);
    if (parameters[j].linear)
      active.parameters[static_cast<Eigen::Index>(j)] = std::clamp(3.0 * parameters[j].typical, low, high);
  }
  return active;
}

TEST(Working, ItsCellsAloneAreTheSame) {
  const testing::SeedFit seed(testing::recording_with({{"warmup_drift", 0.01}}, "Working.ItsCells"));
  Model all;
  int tried = 0;
  const auto compare = [&](const Model& model, const std::string& name) {
    const WorkingProblem with_rows = working_problem(seed.rows, model, seed.fit.state);
    const WorkingCells alone = working_cells(seed.rows, model, seed.fit.state);
    const Cells &a = with_rows.problem.cells, &b = alone.problem.cells;
    ASSERT_EQ(a.size(), b.size());
    ASSERT_EQ(a.effect_slope, b.effect_slope) << name;
    for (std::size_t c = 0; c < a.size(); ++c) {
      EXPECT_NEAR(a.range_mean[c], b.range_mean[c], 1e-12) << name;
      EXPECT_NEAR(a.bearing_mean[c], b.bearing_mean[c], 1e-12) << name;
      EXPECT_NEAR(a.range_mean_square[c], b.range_mean_square[c], 1e-12) << name;
      EXPECT_NEAR(a.bearing_mean_square[c], b.bearing_mean_square[c], 1e-12) << name;
      EXPECT_NEAR(a.range_weight[c], b.range_weight[c], 1e-10 * a.range_weight[c]) << name;
      EXPECT_NEAR(a.bearing_weight[c], b.bearing_weight[c], 1e-10 * a.bearing_weight[c]) << name;
    }
    EXPECT_NEAR(joint_nll(with_rows.problem, seed.fit.state) + with_rows.constant,
                joint_nll(alone.problem, seed.fit.state) + alone.constant, 1e-6)
        << name;
    ++tried;
  };
  for (const Effect* effect : effects_of(seed.rows.context)) {
    if (!effect->lacking(seed.rows.context).empty()) continue;
    const ActiveEffect active = large(*effect, seed.rows.context);
    compare({active}, effect->info().id);
    if (effect->info().kind == EffectKind::mean) all.push_back(active);
  }
  compare(all, "all means");
  EXPECT_GT(tried, 30);
}

}  // namespace
}  // namespace rangecal::diagnosis
