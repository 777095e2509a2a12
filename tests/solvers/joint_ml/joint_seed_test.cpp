// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

// Odometry puts a stop into a landmark that it sees. The likelihood knows no such distance; the seed still has one, and
// the solve from there ends where the solve from the truth ends.
TEST(PositionSeed, StartsThoughACommandedStopStandsInsideALandmark) {
  testing::SceneOptions options;
  for (const bool walk : {false, true}) {
    options.walk = walk;
    options.sigma_s = walk ? 0.05 : 0.1;
    testing::JointScene scene = testing::make_scene("PositionSeed", options);
    JointProblem& problem = scene.problem;
    const int stop = problem.cells.stop[0], landmark = problem.cells.landmark[0];
    problem.stops[stop].commanded.x_m = scene.truth.landmarks[landmark].x() + 0.02;
    problem.stops[stop].commanded.y_m = scene.truth.landmarks[landmark].y() - 0.03;
    problem.stops[stop].sigma_xy_m = 1.0;
    if (walk) problem.stops[stop + 1].sigma_xy_m = 1.0;

    JointState commanded = scene.truth;
    for (std::size_t k = 0; k < problem.stops.size(); ++k) commanded.stops[k] = problem.stops[k].commanded;
    EXPECT_FALSE(std::isfinite(joint_nll(problem, commanded)));
    const JointState seed = position_seed(problem, 2, NoiseLaw::f_squared);
    ASSERT_TRUE(std::isfinite(joint_nll(problem, seed)));
    const JointFit fit = solve_joint_block(problem, seed), known = solve_joint_block(problem, scene.truth);
    EXPECT_EQ(fit.outcome, known.outcome);
    EXPECT_NEAR(fit.joint_nll, known.joint_nll, 1e-6)
        << walk;  // nats; both stop at a Newton decrement far below
  }
}

}  // namespace
}  // namespace rangecal
