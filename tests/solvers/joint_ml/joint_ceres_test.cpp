// SPDX-License-Identifier: BSD-3-Clause
// The two solvers of the joint likelihood reach the same optimum and end with the same outcomes.
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"

#include <gtest/gtest.h>

#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;
using testing::SceneOptions;

struct CeresCase {
  const char* name;
  SceneOptions options;
  bool taped = false;
};

std::vector<CeresCase> ceres_cases() {
  testing::SceneVariants s({.stops = 20, .landmarks = 5});
  s.polynomial.repeats = 10;
  SceneOptions linear = s.plain, exact = s.plain;
  linear.law = NoiseLaw::f;
  linear.sigma_e = 0.05;
  exact.sigma_s = 0.0;
  std::vector<CeresCase> all = s.cases<CeresCase>();
  all.push_back({"linear", linear});
  all.push_back({"exact_stops", exact});
  all.push_back({"taped", s.headings, true});
  return all;
}

class JointCeresTest : public ::testing::TestWithParam<CeresCase> {};

TEST_P(JointCeresTest, AgreesWithTheBlockSolver) {
  for (std::uint64_t repeat = 0; repeat < 3; ++repeat) {
    testing::JointScene scene = make_scene(GetParam().name, GetParam().options, repeat);
    if (GetParam().taped)
      scene.problem.known_distances.push_back(
          {0, 1, (scene.truth.landmarks[0] - scene.truth.landmarks[1]).norm() + 0.003, 0.002});
    const JointState seed = position_seed(scene.problem, 2, GetParam().options.law);
    const JointFit block = solve_joint_block(scene.problem, seed),
                   ceres = solve_joint_ceres(scene.problem, seed);
    ASSERT_EQ(block.outcome, Outcome::converged) << block.reason;
    ASSERT_EQ(ceres.outcome, Outcome::converged) << ceres.reason;
    // Half the square of the remaining gradient norm, 5e-13, and the rounding of about 1e3 nats.
    EXPECT_NEAR(ceres.joint_nll, block.joint_nll, 1e-8) << "repeat " << repeat;
    EXPECT_LT(ceres.gradient_norm, 1e-6);
    EXPECT_LE(ceres.joint_nll, ceres.start_nll);
    ASSERT_TRUE(ceres.covariance && block.covariance);
    EXPECT_LT((*ceres.covariance - *block.covariance).norm(), 1e-5 * block.covariance->norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Shapes, JointCeresTest, ::testing::ValuesIn(ceres_cases()),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(JointCeres, HonoursWhatIsHeld) {
  const testing::JointScene scene = make_scene("held", {.stops = 12, .landmarks = 4, .repeats = 3});
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f_squared);
  for (int which = 0; which < 4; ++which) {
    JointOptions options;
    options.held = {which == 0 || which == 3, which == 1 || which == 3, which == 2 || which == 3};
    const JointFit block = solve_joint_block(scene.problem, seed, options);
    const JointFit ceres = solve_joint_ceres(scene.problem, seed, options);
    ASSERT_EQ(ceres.outcome, Outcome::converged) << which << ": " << ceres.reason;
    EXPECT_NEAR(ceres.joint_nll, block.joint_nll, 1e-8) << which;
    if (options.held.alpha) {
      EXPECT_EQ(ceres.state.alpha, seed.alpha);
    }
    if (options.held.sigmas) {
      EXPECT_EQ(ceres.state.sigma_theta_rad, seed.sigma_theta_rad);
    }
    if (options.held.landmarks) {
      EXPECT_EQ(ceres.state.landmarks[0], seed.landmarks[0]);
    }
  }
}

TEST(JointCeres, NamesTheSigmaThatCollapsesWhereNothingRepeatsAndTwoLandmarksAreSeen) {
  const testing::JointScene scene = make_scene("collapse", {.stops = 20, .landmarks = 2, .sigma_s = 0.05});
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f_squared);
  for (const JointFit& fit :
       {solve_joint_block(scene.problem, seed), solve_joint_ceres(scene.problem, seed)}) {
    EXPECT_EQ(fit.outcome, Outcome::unbounded) << fit.reason;
    EXPECT_NE(fit.reason.find("sigma_"), std::string::npos) << fit.reason;
    EXPECT_FALSE(fit.covariance.has_value());
  }
}

TEST(JointCeres, RefusesAStartOutsideOfTheDomain) {
  const testing::JointScene scene = make_scene("domain", {.stops = 5, .landmarks = 3});
  JointState bad = scene.truth;
  bad.alpha = -bad.alpha;
  const JointFit fit = solve_joint_ceres(scene.problem, bad);
  EXPECT_EQ(fit.outcome, Outcome::failed);
  EXPECT_NE(fit.reason.find("domain"), std::string::npos);
}

}  // namespace
}  // namespace rangecal
