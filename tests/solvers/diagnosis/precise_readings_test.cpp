// SPDX-License-Identifier: BSD-3-Clause
// Readings far more precise than the stops: a change of the stops is seen as well as they are stated, however much of it the estimated
// stops take up.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "diagnosis/projector.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double stop_sigma_m = 0.005;  // [m], of a stop

/// A walk of 14 stops among six landmarks, ten readings of each with a spread of 2e-4 f^2, from stop 7 on moved by `slip_m` along
/// the step to it.
Recording walk(double slip_m, std::uint64_t seed) {
  const std::vector<Eigen::Vector2d> axes{{1.5, 1.2}, {3.2, -1.0}, {-0.8, 0.9},
                                          {4.6, 1.6}, {0.6, -1.4}, {5.5, -0.6}};
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  testing::add_landmarks(recording, axes.size());
  Random random(seed_from("precise readings", {seed}));
  const auto meant = [](int k) { return Pose2{0.3 * k, 0.4 * std::sin(0.7 * k), 0.9 * std::sin(0.6 * k)}; };
  const Pose2 before = meant(6), at = meant(7);
  const Eigen::Vector2d step = Eigen::Vector2d(at.x_m - before.x_m, at.y_m - before.y_m).normalized();
  for (int k = 0; k < 14; ++k) {
    const Pose2 commanded = meant(k);
    testing::add_stop(recording, commanded, stop_sigma_m);
    Eigen::Vector2d place(random.normal(commanded.x_m, stop_sigma_m),
                          random.normal(commanded.y_m, stop_sigma_m));
    if (k >= 7) place += slip_m * step;
    for (int l = 0; l < static_cast<int>(axes.size()); ++l)
      for (int j = 0; j < 10; ++j) {
        const Eigen::Vector2d way = axes[static_cast<std::size_t>(l)] - place;
        const double f = 0.02 + way.norm() * (0.95 + 0.01 * way.norm());
        testing::add_reading(
            recording, k, l, j, random.normal(f, 2e-4 * f * f),
            wrap_angle(std::atan2(way.y(), way.x()) - commanded.heading_rad + random.normal(0.0, 1e-3)));
      }
  }
  return recording;
}

TEST(PreciseReadings, LeaveOfAChangeOfStopsWhatTheStopsAreStatedWith) {
  const Recording recording = walk(0.0, 1);
  const Rows rows = make_rows({&recording, 1});
  const Fit fit = refit(rows, {}, position_seed(rows.problem, 2, NoiseLaw::f_squared), RefitOptions{});
  const Projector projector(rows, working_problem(rows, {}, fit.state), fit.state);
  // One stop moved by 1 m along x, all else known: as precise as its stated place and its readings together, 1 / (sigma^2 + 1 / raw).
  std::vector<Eigen::Vector3d> moved(14, Eigen::Vector3d::Zero());
  moved[5] = {1.0, 0.0, 0.0};
  Signature x = projector.of_stops(moved);
  const double raw = projector.raw_information(x);
  EXPECT_GT(raw, 1e3 / (stop_sigma_m * stop_sigma_m));
  EXPECT_NEAR(projector.beside_stops(x) * stop_sigma_m * stop_sigma_m, 1.0, 2e-3);
  x.moves_stops = true;
  EXPECT_NEAR(projector.least_information(x), 1e-4 * projector.beside_stops(x), 1e-9);
  x.moves_stops = false;
  EXPECT_NEAR(projector.least_information(x), 1e-5 * raw, 1e-9 * raw);
}

TEST(PreciseReadings, ShowASlipOfTenStandardDeviationsOfAStop) {
  const Recording recording = walk(0.05, 2);
  const Diagnosis diagnosis = diagnose({&recording, 1});
  ASSERT_EQ(diagnosis.final_effects, std::vector<std::string>{"wheel_slip"}) << diagnosis.sentence;
  const std::vector<EffectEstimate>& parameters = diagnosis.explanations.at(0).parameters;
  for (const EffectEstimate& p : parameters) {
    if (p.name == "wheel_slip.distance_m") {
      EXPECT_NEAR(p.estimate, 0.05, 3.0 * p.std_dev);
    }
    if (p.name == "wheel_slip.stop") {
      EXPECT_EQ(p.estimate, 7.0);
    }
  }
}

TEST(PreciseReadings, OfNothingAmissSayNothing) {
  const Recording recording = walk(0.0, 3);
  EXPECT_EQ(diagnose({&recording, 1}).verdict, Verdict::no_mismatch);
}

}  // namespace
}  // namespace rangecal::diagnosis
