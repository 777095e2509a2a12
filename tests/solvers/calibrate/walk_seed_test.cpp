// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/walk_seed.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "support/add_reading.hpp"
#include "support/paper_scene.hpp"

namespace rangecal {
namespace {

Recording walk(std::uint64_t repeat) {
  return simulate(testing::long_walk(), seed_from("walk seed", {repeat}));
}

TEST(WalkSeed, StandsWhereStopsAndLandmarksAre) {
  // against truth, which the first stop's own error of 3 cm and 0.01 rad moves as a whole, and a line for the
  // curve
  const Recording r = walk(0);
  const JointState seed = walk_seed(make_joint_problem({&r, 1}), 2, NoiseLaw::f_squared);
  for (std::size_t l = 0; l < seed.landmarks.size(); ++l)
    EXPECT_LT((seed.landmarks[l] - *r.truth.landmarks[l]).norm(), 0.2) << l;
  for (std::size_t k = 0; k < seed.stops.size(); ++k)
    EXPECT_LT(
        std::hypot(seed.stops[k].x_m - r.truth.stops[k]->x_m, seed.stops[k].y_m - r.truth.stops[k]->y_m), 0.3)
        << k;
}

TEST(WalkSeed, CalibrateIsNotLedAstrayByDrift) {
  // At an optimum the marginal NLL is below that of the truth. From the commanded path alone a search ends
  // thousands of nats above it.
  int judged = 0;
  for (std::uint64_t repeat = 0; repeat < 6; ++repeat) {
    const Recording r = walk(repeat);
    CalibrateOptions options;
    options.methods = {Method::marginal};
    options.order = 2;
    options.noise = NoiseLaw::f_squared;
    const Calibration found = calibrate({&r, 1}, options)[0];
    const LaplaceValue at_truth = laplace_marginal(make_joint_problem({&r, 1}), testing::truth_of(r));
    // a path that drifts through a landmark leaves no smooth likelihood, at the truth either, and the answer
    // says so
    if (!at_truth.ok || found.outcome != Outcome::converged) continue;
    ++judged;
    EXPECT_LT(*found.marginal_nll, at_truth.marginal_nll) << repeat;
  }
  EXPECT_GE(judged, 4);
}

/// Eight places, four headings at each, steps of half a metre that are off by 2 cm each, headings exact.
Recording turning_walk(std::uint64_t seed) {
  const Eigen::Vector3d alpha(0.05, 0.9, 0.05);
  const std::vector<Eigen::Vector2d> axes{{2.7, -0.4}, {0.6, 1.5}, {-1.2, 0.6}, {-1.7, -0.7}, {0.9, -2.5}};
  Random random(seed_from("turning walk", {seed}));
  Recording recording;
  recording.path = "made";
  recording.kind = RecordingKind::landmarks;
  recording.stop_error = StopErrorModel::random_walk;
  testing::add_landmarks(recording, axes.size());
  Eigen::Vector2d error = Eigen::Vector2d::Zero();
  for (int place = 0; place < 8; ++place) {
    error += 0.02 * Eigen::Vector2d(random.normal(), random.normal());
    for (int turn = 0; turn < 4; ++turn) {
      const Pose2 meant{-1.5 + 0.5 * place, 0.1 * place, 0.5 * std::numbers::pi * turn};
      testing::add_stop(recording, meant, 0.02, 0.0);
      recording.stops.back().place = std::to_string(place);
      const Eigen::Vector2d at = Eigen::Vector2d(meant.x_m, meant.y_m) + error;
      for (int j = 0; j < 3; ++j)
        for (std::size_t l = 0; l < axes.size(); ++l) {
          const Eigen::Vector2d v = axes[l] - at;
          const double d = v.norm(), f = alpha.dot(Eigen::Vector3d(1.0, d, d * d));
          testing::add_reading(
              recording, 4 * place + turn, static_cast<int>(l), j, f + 0.008 * f * f * random.normal(),
              wrap_angle(std::atan2(v.y(), v.x()) - meant.heading_rad + 0.01 * random.normal()));
        }
    }
  }
  return recording;
}

TEST(WalkSeed, StopsOfAPlaceStandOnOneSpot) {
  // Seeds that put them apart ended apart, hundreds of nats too high: intervals of alpha_1 held 78 %. Those of
  // 40 recordings hold 38 +- 1.4; fewer than 33 do in one case of 2000.
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  int held = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const Recording r = turning_walk(seed);
    const Calibration c = calibrate({&r, 1}, options)[0];
    ASSERT_EQ(c.outcome, Outcome::converged) << seed << ": " << c.reason;
    held += std::abs(c.alpha[1] - 0.9) < 1.96 * std::sqrt((*c.alpha_covariance)(1, 1));
    for (std::size_t k = 1; k < c.stops.size(); ++k) {
      if (r.stops[k].place != r.stops[k - 1].place) continue;
      EXPECT_NEAR(c.stops[k].pose.x_m, c.stops[k - 1].pose.x_m, 1e-12);
    }
  }
  EXPECT_GE(held, 33);
}

}  // namespace
}  // namespace rangecal
