// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/plan/plan.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"

namespace rangecal {
namespace {

/// The sensor of the 2021 setting in a room of 6 by 5 m.
PlanRequest request_of(double accuracy_m) {
  PlanRequest request;  // few landmarks, so that the search is short
  Scene& s = request.sketch;
  s.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  s.noise = {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.01)};
  s.sigma_theta_rad = 0.0087;
  s.sensor.range_min_m = 0.1;
  s.sensor.range_max_m = 10.0;
  s.random_landmarks = RandomLandmarks{3, {0.0, 0.0}, {6.0, 5.0}};
  request.accuracy_m = accuracy_m;
  request.most_landmarks = 4;
  return request;
}

/// Largest standard deviation of a corrected distance under a covariance of alpha.
double largest(const PlanRequest& request, const Eigen::MatrixXd& C) {
  double value = 0.0;
  for (int i = 0; i <= 8; ++i) {
    const double d = request.low_m + (request.high_m - request.low_m) * i / 8.0;
    const Eigen::Vector3d phi(1.0, d, d * d);
    value = std::max(value, std::sqrt(phi.dot(C.topLeftCorner(3, 3) * phi)) /
                                evaluate_derivative(request.sketch.alpha, d));
  }
  return value;
}

TEST(Plan, ReachesTheAccuracyInNoMoreTimeThanTheLine) {
  for (const double accuracy : {0.02, 0.009}) {
    const PlanRequest request = request_of(accuracy);
    const Plan plan = plan_experiment(request);
    ASSERT_EQ(plan.outcome, Outcome::converged) << plan.reason;
    EXPECT_LE(plan.best.std_dev_m, accuracy);
    if (plan.line) {
      EXPECT_LE(plan.line->std_dev_m, accuracy);
      EXPECT_LE(plan.best.minutes, plan.line->minutes);
    }
    // by hand: places 30 s, turns 10 s, landmarks 60 s, scans 0.2 s
    const PlanDesign& d = plan.best;
    EXPECT_NEAR(d.minutes,
                (30.0 * d.places + 10.0 * d.places * (d.headings - 1) +
                 60.0 * static_cast<double>(d.landmarks.size()) + 0.2 * d.places * d.headings * d.repeats) /
                    60.0,
                1e-9);
    for (const Stop& stop : d.stops)
      for (const Eigen::Vector2d& m : d.landmarks)
        EXPECT_GE((m - Eigen::Vector2d(stop.commanded.x_m, stop.commanded.y_m)).norm(), 0.4);
  }
}

TEST(Plan, AccuracyIsTheCramerRaoBound) {
  const PlanRequest request = request_of(0.012);
  const Plan plan = plan_experiment(request);
  const Recording recording = simulate(planned_scene(request, plan.best), 1);
  const JointProblem problem = make_joint_problem({&recording, 1});
  JointState truth;
  truth.alpha = request.sketch.alpha;
  truth.noise = request.sketch.noise;
  truth.sigma_theta_rad = request.sketch.sigma_theta_rad;
  for (const Stop& stop : plan.best.stops) truth.stops.push_back(stop.commanded);
  truth.landmarks = plan.best.landmarks;
  const auto bound = cramer_rao_bound(problem, truth);
  ASSERT_TRUE(bound);
  // The bound also counts what the spread says about the curve, some 2 (2 sigma f)^2 = 0.3 % of the information at 4 m.
  EXPECT_NEAR(largest(request, *bound), plan.best.std_dev_m, 0.01 * plan.best.std_dev_m);
}

/// Rehearses a plan 120 times: its calibrations must be as accurate as it says.
void expect_as_accurate_as_said(const PlanRequest& request) {
  const Plan plan = plan_experiment(request);
  const Scene scene = planned_scene(request, plan.best);
  // z = error / stated deviation at the distance where it is largest, over 120 rehearsals: mean square 1 with a
  // standard deviation of sqrt(2 / 120) = 0.13; the curve is not linear in the unknowns, hence 4.5 of them.
  double worst_d = request.low_m, worst = 0.0, sum = 0.0;
  int count = 0;
  for (std::uint64_t seed = 0; seed < 120; ++seed) {
    const Recording recording = simulate(scene, seed_from("plan rehearsal", {seed}));
    CalibrateOptions options;
    options.methods = {Method::marginal};
    options.order = 2;
    options.noise = NoiseLaw::f_squared;
    const Calibration c = calibrate({&recording, 1}, options)[0];
    if (c.outcome != Outcome::converged) continue;
    if (count == 0)
      for (double d = request.low_m; d <= request.high_m; d += 0.4375) {
        const Eigen::Vector3d phi(1.0, d, d * d);
        const double value =
            std::sqrt(phi.dot(*c.alpha_covariance * phi)) / evaluate_derivative(request.sketch.alpha, d);
        if (value > worst) {
          worst = value;
          worst_d = d;
        }
      }
    const Eigen::VectorXd delta = c.alpha - request.sketch.alpha;
    sum +=
        std::pow(evaluate_polynomial(delta, worst_d) / evaluate_derivative(request.sketch.alpha, worst_d), 2);
    ++count;
  }
  ASSERT_GE(count, 115);
  EXPECT_NEAR(sum / count / std::pow(plan.best.std_dev_m, 2), 1.0, 4.5 * std::sqrt(2.0 / count));
}

TEST(Plan, CalibrationsOfThePlanAreAsAccurateAsSaid) { expect_as_accurate_as_said(request_of(0.012)); }

// A radio or sonar: what bearings told of the landmarks the ranges of more stops have to tell.
TEST(Plan, OfRangesAloneAsWell) {
  PlanRequest request = request_of(0.012);
  request.sketch.reads_bearings = false;
  request.sketch.sigma_theta_rad = 0.0;
  expect_as_accurate_as_said(request);

  const Plan with = plan_experiment(request_of(0.012)), without = plan_experiment(request);
  ASSERT_EQ(without.outcome, Outcome::converged) << without.reason;
  EXPECT_GT(without.best.minutes, with.best.minutes);
  EXPECT_TRUE(without.best.path == "two legs" || without.best.path == "loop") << without.best.path;
  EXPECT_FALSE(planned_scene(request, without.best).reads_bearings);

  request.effects = {"bearing_scale"};
  EXPECT_THROW(plan_experiment(request), InputError);
}

TEST(Plan, EffectsCostAccuracyAndAreSaidToShowOrNot) {
  PlanRequest request = request_of(0.015);
  const PlanDesign plain = plan_experiment(request).best;
  request.effects = {"range_eccentricity", "bearing_offset", "tilt"};
  const PlanDesign with = evaluate_design(request, plain);
  EXPECT_GE(with.std_dev_m, plain.std_dev_m);
  ASSERT_EQ(with.effects.size(), 3u);
  for (const PlanEffect& effect : with.effects) {
    EXPECT_GE(effect.noncentrality, 0.0);
    EXPECT_TRUE(std::isfinite(effect.harm_m));
  }
  // A hundred times the repeats shows at least what few show.
  PlanDesign many = plain;
  many.repeats *= 20;
  many = evaluate_design(request, many);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_GE(many.effects[i].noncentrality, with.effects[i].noncentrality * 0.999);
  const Plan plan = plan_experiment(request);
  EXPECT_EQ(plan.outcome == Outcome::converged, plan.best.std_dev_m <= request.accuracy_m);
}

TEST(Plan, SaysWhatItCannotReach) {
  const Plan plan = plan_experiment(request_of(1e-5));
  EXPECT_EQ(plan.outcome, Outcome::not_converged);
  EXPECT_GT(plan.best.std_dev_m, 1e-5);
  EXPECT_GT(plan.best.places, 0);
  EXPECT_FALSE(plan.reason.empty());
  PlanRequest far = request_of(0.01);
  far.low_m = 8.0;
  far.high_m = 9.5;  // the room has no such distances
  EXPECT_EQ(plan_experiment(far).outcome, Outcome::failed);
  PlanRequest bad = request_of(0.01);
  bad.effects = {"no_such_effect"};
  EXPECT_THROW(plan_experiment(bad), InputError);
  bad = request_of(-1.0);
  EXPECT_THROW(plan_experiment(bad), InputError);
  bad = request_of(0.01);
  bad.sketch.random_landmarks.reset();  // no room at all
  EXPECT_THROW(plan_experiment(bad), InputError);
  bad = request_of(0.01);
  bad.radii_m.clear();
  EXPECT_THROW(plan_experiment(bad), InputError);
}

}  // namespace
}  // namespace rangecal
