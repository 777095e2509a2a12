// SPDX-License-Identifier: BSD-3-Clause
// NLopt reaches the joint optimum of our solvers, or finds a better basin, and says which.
#include "rangecal/solvers/nlopt/joint_check.hpp"

#include <gtest/gtest.h>

#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;
using testing::SceneOptions;

TEST(JointCheck, AgreesOnTwoHundredRandomScenes) {
  NloptOptions options;
  options.global_evaluations = 200;
  for (std::uint64_t i = 0; i < 200; ++i) {
    SceneOptions o{.stops = 8, .landmarks = 4, .repeats = 1 + static_cast<int>(i % 3)};
    o.law = i % 2 ? NoiseLaw::f_squared : NoiseLaw::f;
    o.sigma_e = i % 2 ? 0.01 : 0.05;
    o.sigma_theta = i % 4 < 2 ? 0.0087 : 0.035;
    o.sigma_s = i % 8 < 4 ? 0.01 : 0.05;
    o.turns = i % 5 == 0;
    o.sigma_heading = i % 10 == 0 && o.repeats > 1 ? 0.01 : 0.0;
    o.walk = i % 7 == 0;
    const testing::JointScene scene = make_scene("joint check", o, i);
    const JointState seed = position_seed(scene.problem, 2, o.law);
    const JointFit fit = solve_joint_block(scene.problem, seed);
    if (fit.outcome == Outcome::unbounded) continue;
    ASSERT_EQ(fit.outcome, Outcome::converged) << i << ": " << fit.reason;
    // The seed may lie in another basin than the one that Newton's longer steps end in: then NLopt starts from there.
    JointCheck check = check_joint(scene.problem, seed, fit.joint_nll, options);
    ASSERT_TRUE(check.done) << check.reason;
    if (!check.result.agrees) check = check_joint(scene.problem, fit.state, fit.joint_nll, options);
    EXPECT_NEAR(check.result.nll, fit.joint_nll, 1e-6) << i << ": " << check.result.report;
  }
}

TEST(JointCheck, SaysThatAPointIsNoOptimum) {
  const testing::JointScene scene = make_scene("no optimum", {.stops = 8, .landmarks = 4});
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f_squared);
  const JointFit fit = solve_joint_block(scene.problem, seed);
  const JointCheck check = check_joint(scene.problem, seed, fit.joint_nll + 0.5);
  ASSERT_TRUE(check.done);
  EXPECT_FALSE(check.result.agrees);
  EXPECT_TRUE(check.result.better_basin);
}

TEST(JointCheck, IsNotDoneWhereThereIsNoMaximum) {
  const testing::JointScene scene = make_scene("collapse", {.stops = 20, .landmarks = 2, .sigma_s = 0.05});
  const JointCheck check =
      check_joint(scene.problem, position_seed(scene.problem, 2, NoiseLaw::f_squared), 0.0);
  EXPECT_FALSE(check.done);
  EXPECT_NE(check.reason.find("no maximum"), std::string::npos);
}

}  // namespace
}  // namespace rangecal
