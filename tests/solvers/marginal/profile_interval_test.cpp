// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/marginal/profile_interval.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "hard/judge.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

constexpr double rise =
    0.5 * 3.841458820694124;  // half the 95 % point of chi-square with one degree of freedom

TEST(ProfileInterval, EndsWhereTheCriterionHasRisenByHalfTheQuantile) {
  const testing::JointScene scene =
      testing::make_scene("profile", {.stops = 20, .landmarks = 5, .sigma_s = 0.02});
  const MarginalFit fit = solve_marginal(scene.problem, position_seed(scene.problem, 2, NoiseLaw::f_squared));
  ASSERT_EQ(fit.outcome, Outcome::converged);
  const double lowest = hard::marginal_at(scene.problem, fit.state).criterion;
  for (Sigma which : {Sigma::noise, Sigma::theta}) {
    const auto interval = profile_interval(scene.problem, fit.state, which, 0.1);
    ASSERT_TRUE(interval);
    const double estimate = which == Sigma::noise ? fit.state.noise.parameters[0] : fit.state.sigma_theta_rad;
    EXPECT_LT(interval->low, estimate);
    EXPECT_GT(interval->high, estimate);
    for (double end : {interval->low, interval->high}) {
      JointState at = fit.state;
      (which == Sigma::noise ? at.noise.parameters[0] : at.sigma_theta_rad) = end;
      MarginalOptions options;
      options.held_sigma = which;
      const MarginalFit there = solve_marginal(scene.problem, at, options);
      ASSERT_EQ(there.outcome, Outcome::converged);
      // Ends are found to 2e-3 of the half width, over which the criterion rises by twice its bar: 0.01.
      EXPECT_NEAR(hard::marginal_at(scene.problem, there.state).criterion - lowest, rise, 0.02);
    }
  }
}

TEST(ProfileInterval, OfBearingsFromExactStopsIsThatOfAVariance) {
  // Exact stops: sigma_theta^2 is a sum of squares with nu degrees of freedom, whose profile is nu / 2 (x - 1
  // - log x), x = (s / sigma)^2. nu is the number of bearings less what they give to the 13 of curve and
  // landmarks, which ranges share.
  const testing::JointScene scene = testing::make_scene(
      "variance", {.stops = 20, .landmarks = 5, .law = NoiseLaw::constant, .sigma_e = 0.05, .sigma_s = 0.0});
  const MarginalFit fit = solve_marginal(scene.problem, scene.truth);
  ASSERT_EQ(fit.outcome, Outcome::converged);
  const auto interval = profile_interval(scene.problem, fit.state, Sigma::theta, 0.07);
  ASSERT_TRUE(interval);
  for (double end : {interval->low, interval->high}) {
    const double x = std::pow(fit.state.sigma_theta_rad / end, 2);
    const double nu = 2.0 * rise / (x - 1.0 - std::log(x));
    const double bearings = static_cast<double>(scene.problem.cells.size());
    EXPECT_GT(nu, bearings - 13.0);
    EXPECT_LT(nu, bearings);
  }
}

TEST(SigmaSlopes, OfExactStopsScaleWithTheVariancesAndGiveDegreesOfFreedomBetweenTheirs) {
  // Exact stops: C is homogeneous of degree one in the two variances, so that its slopes in log sigma_e and log sigma_theta
  // add up to 2 C. Satterthwaite's nu of any mixture of two lies between the smaller nu and the sum of both.
  const testing::JointScene scene = testing::make_scene(
      "variance", {.stops = 20, .landmarks = 5, .law = NoiseLaw::constant, .sigma_e = 0.05, .sigma_s = 0.0});
  const MarginalFit fit = solve_marginal(scene.problem, scene.truth);
  ASSERT_EQ(fit.outcome, Outcome::converged);
  const auto slopes = sigma_slopes(scene.problem, fit.state);
  ASSERT_TRUE(slopes);
  ASSERT_EQ(slopes->slopes.size(), 2u);
  // Differences of step 1e-4, exact to its square.
  EXPECT_TRUE((slopes->slopes[0] + slopes->slopes[1]).isApprox(2.0 * slopes->covariance, 1e-6));
  const double readings = static_cast<double>(scene.problem.cells.size());
  for (Eigen::Index i = 0; i < slopes->covariance.rows(); ++i) {
    const double nu = slopes->degrees_of_freedom(Eigen::VectorXd::Unit(slopes->covariance.rows(), i));
    EXPECT_GT(nu, readings - 14.0) << i;
    EXPECT_LT(nu, 2.0 * readings) << i;
  }
}

TEST(ProfileInterval, OfStopsStartsAtZeroWhereNoneIsFound) {
  int at_zero = 0;
  for (std::uint64_t repeat = 0; repeat < 4; ++repeat) {
    testing::JointScene scene =
        testing::make_scene("no slip", {.stops = 20, .landmarks = 5, .sigma_s = 0.0}, repeat);
    scene.problem.estimate_sigma_s = true;
    scene.problem.sigma_s_shared.assign(scene.problem.stops.size(), 1);
    MarginalOptions options;
    options.estimate_sigma_s = true;
    const MarginalFit fit =
        solve_marginal(scene.problem, position_seed(scene.problem, 2, NoiseLaw::f_squared), options);
    ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
    const auto interval = profile_interval(scene.problem, fit.state, Sigma::stops);
    ASSERT_TRUE(interval) << repeat;
    EXPECT_GT(interval->high, *fit.state.sigma_s_m) << repeat;
    if (*fit.state.sigma_s_m > 0.0) continue;
    ++at_zero;
    EXPECT_EQ(interval->low, 0.0) << repeat;
    ASSERT_TRUE(fit.sigma_s_upper95_m);
    EXPECT_GT(interval->high, *fit.sigma_s_upper95_m) << repeat;  // two-sided against one-sided
  }
  EXPECT_GT(at_zero, 0);
}

TEST(ProfileInterval, NoneForThePolynomialLawAndForASigmaThatWasGiven) {
  const testing::JointScene scene = testing::make_scene("none", {.law = NoiseLaw::polynomial});
  EXPECT_FALSE(profile_interval(scene.problem, scene.truth, Sigma::noise));
  EXPECT_FALSE(profile_interval(scene.problem, scene.truth, Sigma::stops));
}

}  // namespace
}  // namespace rangecal
