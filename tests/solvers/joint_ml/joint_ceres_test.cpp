// SPDX-License-Identifier: BSD-3-Clause
// The two solvers of the joint likelihood reach the same optimum and end with the same outcomes.
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <map>
#include <utility>

#include "rangecal/solvers/calibrate.hpp"
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

/// By how much the default of `calibrate` and the other solver differ over many problems.
struct SolverDifferences {
  int converged = 0, alike_otherwise = 0;
  std::map<std::pair<Outcome, Outcome>, int> outcomes_that_differ;
  double nll = 0.0, estimate = 0.0, covariance = 0.0;  ///< largest: nats; standard deviations; relative
  double block_s = 0.0, ceres_s = 0.0;                 ///< time of all solves
};

TEST(JointCeres, TheDefaultAndTheOtherSolverAgreeOnTenThousandProblems) {
  // Small ones of every shape: 6 to 11 stops, 3 to 5 landmarks, 1 to 3 repeats, fitted with order 1 (too low) or 2.
  ASSERT_EQ(CalibrateOptions{}.solver, JointSolver::block);
  SolverDifferences all;
  const auto timed = [](double& sum_s, const auto& solve, const auto&... arguments) {
    const auto begin = std::chrono::steady_clock::now();
    const JointFit fit = solve(arguments..., JointOptions{});
    sum_s += std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    return fit;
  };
  const auto shapes = testing::SceneVariants(SceneOptions{}).cases<CeresCase>();
  for (std::uint64_t number = 0; number < 10000; ++number) {
    CeresCase shape = shapes[number % shapes.size()];
    shape.options.stops = 6 + static_cast<int>(number / 15 % 6);
    shape.options.landmarks = 3 + static_cast<int>(number / 90 % 3);
    shape.options.repeats = 1 + static_cast<int>(number / 270 % 3);
    const testing::JointScene scene = make_scene("ten thousand", shape.options, number);
    const int order = 1 + static_cast<int>(number / 810 % 2);
    const JointState seed = position_seed(scene.problem, order, shape.options.law);
    const JointFit block = timed(all.block_s, solve_joint_block, scene.problem, seed);
    const JointFit ceres = timed(all.ceres_s, solve_joint_ceres, scene.problem, seed);
    if (ceres.outcome != block.outcome) {
      ++all.outcomes_that_differ[{ceres.outcome, block.outcome}];
      continue;
    }
    if (ceres.outcome != Outcome::converged) {
      ++all.alike_otherwise;
      continue;
    }
    ++all.converged;
    all.nll = std::max(all.nll, std::abs(ceres.joint_nll - block.joint_nll));
    ASSERT_EQ(ceres.covariance.has_value(), block.covariance.has_value()) << number;
    if (!block.covariance) continue;
    all.covariance =
        std::max(all.covariance, (*ceres.covariance - *block.covariance).norm() / block.covariance->norm());
    for (Eigen::Index j = 0; j < block.state.alpha.size(); ++j)
      all.estimate = std::max(all.estimate, std::abs(ceres.state.alpha[j] - block.state.alpha[j]) /
                                                std::sqrt((*block.covariance)(j, j)));
  }
  fmt::print(
      "{} converged by both: they differ by at most {:.1e} nats in the NLL, {:.1e} standard deviations in alpha,\n"
      "{:.1e} in the covariance; {} ended alike otherwise\n",
      all.converged, all.nll, all.estimate, all.covariance, all.alike_otherwise);
  for (const auto& [outcomes, count] : all.outcomes_that_differ) {
    fmt::print("{} {} by Ceres, {} by blocks\n", count, to_string(outcomes.first),
               to_string(outcomes.second));
    // Where Ceres's sums of squares round away what is left to gain, `calibrate` goes on by blocks (LandmarksJob::full).
    EXPECT_EQ(outcomes, std::pair(Outcome::not_converged, Outcome::converged));
    EXPECT_LE(count, 100);  // one in a hundred
  }
  fmt::print("a solve takes {:.3f} ms by Ceres, {:.3f} ms by blocks\n", 0.1 * all.ceres_s, 0.1 * all.block_s);
  EXPECT_LT(all.nll, 1e-8);       // as above
  EXPECT_LT(all.estimate, 1e-4);  // no digit that is printed
  EXPECT_LT(all.covariance, 1e-4);
}

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
