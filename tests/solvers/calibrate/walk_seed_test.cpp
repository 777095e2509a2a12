// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/walk_seed.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
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

}  // namespace
}  // namespace rangecal
