// SPDX-License-Identifier: BSD-3-Clause
// Laplace's method against integrals that can be done another way, REML against its closed form, and the outcomes.
#include "rangecal/solvers/marginal/marginal.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "marginal/laplace.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;

const double log_two_pi = std::log(2.0 * std::numbers::pi);

/// Readings of one stop at the origin, alpha = (0, 1), one reading per landmark.
testing::JointScene one_stop(const std::vector<Eigen::Vector2d>& landmarks, double sigma_s,
                             const std::vector<double>& range_errors,
                             const std::vector<double>& bearing_errors) {
  testing::JointScene scene;
  JointProblem& p = scene.problem;
  StopPrior prior;
  prior.sigma_xy_m = sigma_s;
  p.stops.push_back(prior);
  p.place_count = 1;
  p.sigma_s_shared = {0};
  Cells& c = p.cells;
  for (std::size_t l = 0; l < landmarks.size(); ++l) {
    p.landmark_radius_m.push_back(0.0);
    p.landmark_recording.push_back(0);
    c.stop.push_back(0);
    c.landmark.push_back(static_cast<int>(l));
    c.count.push_back(1.0);
    c.range_mean.push_back(landmarks[l].norm() + range_errors[l]);
    c.bearing_mean.push_back(std::atan2(landmarks[l].y(), landmarks[l].x()) + bearing_errors[l]);
    c.radius_m.push_back(0.0);
  }
  c.range_weight = c.bearing_weight = c.count;
  c.range_mean_square = c.bearing_mean_square = std::vector<double>(landmarks.size(), 0.0);
  c.stop_begin = {0, static_cast<int>(landmarks.size())};
  p.readings = static_cast<double>(landmarks.size());
  scene.truth.alpha = Eigen::Vector2d(0.0, 1.0);
  scene.truth.noise.law = NoiseLaw::constant;
  scene.truth.noise.parameters = Eigen::VectorXd::Constant(1, 0.05);
  scene.truth.sigma_theta_rad = 0.02;
  scene.truth.stops = {{}};
  scene.truth.landmarks = landmarks;
  return scene;
}

TEST(LaplaceMarginal, IsExactForALinearGaussianStop) {
  // Landmarks 1e6 m away on the two axes: d = 1e6 - x and 1e6 - y, bearings do not tell. Then, with e the range error,
  // y ~ N(0, s^2 + sigma_s^2) on each axis: e^2 / (2 v) + log(2 pi v) / 2, v = 0.05^2 + 0.04^2 = 0.0041, and for the
  // bearings b^2 / (2 0.02^2) + log 0.02 + log(2 pi) / 2.
  const testing::JointScene scene = one_stop({{1e6, 0.0}, {0.0, 1e6}}, 0.04, {0.07, -0.03}, {0.01, 0.005});
  const LaplaceValue value = laplace_marginal(scene.problem, scene.truth);
  ASSERT_TRUE(value.ok);
  const double v = 0.0041;
  const double range = (0.07 * 0.07 + 0.03 * 0.03) / (2 * v) + std::log(v) + log_two_pi;
  const double bearing = (1e-4 + 0.25e-4) / (2 * 4e-4) + 2 * std::log(0.02) + log_two_pi;
  // Curvature 1e-6 1/m over steps of 0.1 m, and the rounding of readings of 1e6 m: 1e-10 m over 0.05 m.
  EXPECT_NEAR(value.marginal_nll, range + bearing, 1e-6);
}

TEST(LaplaceMarginal, IsCloseToTheIntegralOverTheStop) {
  testing::JointScene scene =
      one_stop({{1.5, 0.4}, {-0.8, 1.7}, {0.3, -2.2}}, 0.05, {0.03, -0.06, 0.02}, {0.01, -0.02, 0.03});
  scene.truth.noise.law = NoiseLaw::f_squared;
  for (double shrink : {1.0, 0.5, 0.25}) {
    scene.problem.stops[0].sigma_xy_m = 0.05 * shrink;
    JointState at = scene.truth;
    const LaplaceValue laplace = laplace_marginal(scene.problem, at);
    ASSERT_TRUE(laplace.ok);
    // Trapezoids over +-7 sigma_s: spectral accuracy for a smooth integrand that vanishes at the ends.
    const int n = 300;
    const double width = 7.0 * 0.05 * shrink, h = 2.0 * width / n;
    double sum = 0.0;
    for (int i = 0; i <= n; ++i)
      for (int j = 0; j <= n; ++j) {
        at.stops[0] = {-width + i * h, -width + j * h, 0.0};
        sum += std::exp(laplace.joint_nll - joint_nll(scene.problem, at));
      }
    const double integral = laplace.joint_nll - std::log(sum * h * h);
    // Laplace's error falls with the square of the posterior's width over the geometry's scale: 0.04 m over 1.5 m.
    EXPECT_NEAR(laplace.marginal_nll, integral, 0.01 * shrink) << shrink;
  }
}

TEST(LaplaceMarginal, WhereAStateHasItsStopsRisesBySquaresFromTheirOptimum) {
  const testing::JointScene scene =
      one_stop({{1.5, 0.4}, {-0.8, 1.7}, {0.3, -2.2}}, 0.05, {0.03, -0.06, 0.02}, {0.01, -0.02, 0.03});
  const LaplaceValue settled = laplace_marginal(scene.problem, scene.truth);
  ASSERT_TRUE(settled.ok);
  const double least = laplace_nll_at(scene.problem, settled.state);
  EXPECT_NEAR(least, settled.marginal_nll, 1e-9);
  const auto rise_at = [&](double step) {
    double sum = 0.0;  // of both sides: what is odd in the step goes
    for (const double side : {-1.0, 1.0}) {
      JointState moved = settled.state;
      moved.stops[0].x_m += side * step;
      sum += laplace_nll_at(scene.problem, moved) - least;
    }
    return sum;
  };
  EXPECT_GT(rise_at(0.002), 0.0);
  EXPECT_NEAR(rise_at(0.004) / rise_at(0.002), 4.0, 0.05);
  JointState outside = settled.state;
  outside.noise.parameters[0] = -1.0;
  EXPECT_FALSE(std::isfinite(laplace_nll_at(scene.problem, outside)));
}

TEST(LaplaceMarginal, StopsAreSettledNoFartherThanIsEnough) {
  const testing::JointScene scene =
      one_stop({{1.5, 0.4}, {-0.8, 1.7}, {0.3, -2.2}}, 0.05, {0.03, -0.06, 0.02}, {0.01, -0.02, 0.03});
  const auto evaluations_to = [&](double enough) {
    JointState state = scene.truth;
    state.stops[0] = {0.1, -0.1, 0.0};
    JointSystem system(scene.problem, 2, 1);
    int evaluations = 0;
    EXPECT_TRUE(std::isfinite(settle_stops(system, state, evaluations, enough)));
    const double left = system.stop_gradient().dot(system.solve_stops(system.stop_gradient()));
    EXPECT_LT(left, std::max(enough, 1e-12));
    return evaluations;
  };
  EXPECT_LT(evaluations_to(1e-2), evaluations_to(0.0));
}

TEST(Marginal, VariancesLoseTheDegreesOfFreedomOfTheCurve) {
  // Exact stops, landmarks held, constant noise: ranges are a linear regression on three coefficients and bearings have
  // none, so REML gives sigma^2 = RSS / (N - 3) and sigma_theta^2 = RSS / N.
  testing::JointScene scene = make_scene(
      "reml", {.stops = 8, .landmarks = 4, .law = NoiseLaw::constant, .sigma_e = 0.05, .sigma_s = 0.0});
  MarginalOptions options;
  options.held.landmarks = true;
  const MarginalFit fit = solve_marginal(scene.problem, scene.truth, options);
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  const Cells& c = scene.problem.cells;
  const Eigen::Index n = static_cast<Eigen::Index>(c.size());
  Eigen::MatrixXd rows(n, 3);
  Eigen::VectorXd y(n);
  double turns = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const Pose2& pose = scene.truth.stops[c.stop[i]];
    const Eigen::Vector2d v = scene.truth.landmarks[c.landmark[i]] - Eigen::Vector2d(pose.x_m, pose.y_m);
    const double d = v.norm() - c.radius_m[i];
    rows.row(i) << 1.0, d, d * d;
    y[i] = c.range_mean[i];
    turns += std::pow(wrap_angle(c.bearing_mean[i] - std::atan2(v.y(), v.x())), 2);
  }
  const Eigen::Vector3d alpha = (rows.transpose() * rows).ldlt().solve(rows.transpose() * y);
  const double rss = (y - rows * alpha).squaredNorm();
  EXPECT_LT((fit.state.alpha - alpha).norm(), 1e-7);
  // Slopes by central differences of step 1e-3 in log sigma: exact for 1/2 log det A = -3 log sigma.
  EXPECT_NEAR(fit.state.noise.parameters[0], std::sqrt(rss / (n - 3)), 1e-7);
  EXPECT_NEAR(fit.state.sigma_theta_rad, std::sqrt(turns / n), 1e-7);
}

TEST(Marginal, GradientOfAllParametersVanishesAtTheEstimate) {
  const testing::JointScene scene = make_scene("gradient", {.stops = 20, .landmarks = 5, .sigma_s = 0.05});
  const MarginalFit fit = solve_marginal(scene.problem, position_seed(scene.problem, 2, NoiseLaw::f_squared));
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_LT(fit.gradient_norm, 1e-6);
  // With the sigmas held, phi minimises l_s alone: every small step in alpha raises it.
  for (int a = 0; a < 3; ++a)
    for (double step : {-1e-4, 1e-4}) {
      JointState moved = fit.state;
      moved.alpha[a] += step;
      EXPECT_GT(laplace_marginal(scene.problem, moved).marginal_nll, fit.marginal_nll) << a;
    }
}

TEST(Marginal, ASigmaOfTheStopsThatComesOutAtZeroHasAnUpperLimit) {
  int at_zero = 0;
  for (std::uint64_t repeat = 0; repeat < 6; ++repeat) {
    testing::JointScene scene = make_scene("sigma_s", {.stops = 20, .landmarks = 5, .sigma_s = 0.0}, repeat);
    scene.problem.estimate_sigma_s = true;
    scene.problem.sigma_s_shared.assign(scene.problem.stops.size(), 1);
    MarginalOptions options;
    options.estimate_sigma_s = true;
    const MarginalFit fit =
        solve_marginal(scene.problem, position_seed(scene.problem, 2, NoiseLaw::f_squared), options);
    ASSERT_EQ(fit.outcome, Outcome::converged) << repeat << ": " << fit.reason;
    ASSERT_TRUE(fit.state.sigma_s_m.has_value());
    if (*fit.state.sigma_s_m > 0.0) {
      EXPECT_LT(*fit.state.sigma_s_m, 0.02);
      EXPECT_FALSE(fit.sigma_s_upper95_m.has_value());
      continue;
    }
    ++at_zero;
    ASSERT_TRUE(fit.sigma_s_upper95_m.has_value());
    EXPECT_GT(*fit.sigma_s_upper95_m, 1e-4);
    EXPECT_LT(*fit.sigma_s_upper95_m, 0.03);
  }
  EXPECT_GT(at_zero, 0);
}

TEST(Marginal, ConvergesWhereTheJointLikelihoodHasNoMaximum) {
  const testing::JointScene scene =
      make_scene("two landmarks", {.stops = 16, .landmarks = 2, .sigma_theta = 0.02, .sigma_s = 0.02});
  const JointState seed = position_seed(scene.problem, 2, NoiseLaw::f_squared);
  const JointFit full = solve_joint_block(scene.problem, seed);
  EXPECT_EQ(full.outcome, Outcome::unbounded);
  EXPECT_NE(full.reason.find("sigma_theta"), std::string::npos);
  JointOptions held;
  held.held.sigmas = true;
  const JointFit start = solve_joint_block(scene.problem, seed, held);
  ASSERT_EQ(start.outcome, Outcome::converged) << start.reason;
  const MarginalFit fit = solve_marginal(scene.problem, start.state);
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  EXPECT_GT(fit.state.sigma_theta_rad, 0.3 * 0.02);
  EXPECT_LT(fit.state.sigma_theta_rad, 3.0 * 0.02);
}

/// The 2021 setting with repeats, as a recording.
Recording repeated_recording() {
  const testing::JointScene scene =
      make_scene("rows", {.stops = 12, .landmarks = 4, .law = NoiseLaw::f, .sigma_e = 0.03});
  Random random(seed_from("rows draws", {}));
  Recording recording;
  recording.sigma_xy_m = 0.01;
  recording.stops.resize(scene.problem.stops.size());
  for (std::size_t k = 0; k < recording.stops.size(); ++k)
    recording.stops[k].commanded = scene.problem.stops[k].commanded;
  for (std::size_t l = 0; l < scene.truth.landmarks.size(); ++l)
    recording.landmarks.push_back({"m" + std::to_string(l), 0.12, {}});
  for (int repeat = 0; repeat < 4; ++repeat)
    for (std::size_t k = 0; k < recording.stops.size(); ++k)
      for (std::size_t l = 0; l < recording.landmarks.size(); ++l) {
        const Pose2& pose = scene.truth.stops[k];
        const Eigen::Vector2d v = scene.truth.landmarks[l] - Eigen::Vector2d(pose.x_m, pose.y_m);
        const double f = evaluate_polynomial(scene.truth.alpha, v.norm() - 0.12);
        recording.readings.stop.push_back(static_cast<int>(k));
        recording.readings.landmark.push_back(static_cast<int>(l));
        recording.readings.repeat.push_back(repeat);
        recording.readings.range_m.push_back(f + random.normal(0, 0.03 * f));
        recording.readings.bearing_rad.push_back(std::atan2(v.y(), v.x()) + random.normal(0, 0.0087));
      }
  return recording;
}

TEST(Marginal, RowsAndCellsHaveTheSameOptimum) {
  const std::vector<Recording> recordings = {repeated_recording()};
  const JointProblem cells = make_joint_problem(recordings, Grouping::cells);
  const JointProblem rows = make_joint_problem(recordings, Grouping::rows);
  ASSERT_EQ(rows.cells.size(), 4 * cells.cells.size());
  const JointState seed = position_seed(cells, 2, NoiseLaw::f);
  JointOptions options;
  options.gradient_tolerance = 1e-9;
  const JointFit full_cells = solve_joint_block(cells, seed, options),
                 full_rows = solve_joint_block(rows, seed, options);
  ASSERT_EQ(full_cells.outcome, Outcome::converged);
  ASSERT_EQ(full_rows.outcome, Outcome::converged);
  EXPECT_NEAR(full_rows.joint_nll, full_cells.joint_nll, 1e-9 * std::abs(full_cells.joint_nll));
  EXPECT_LT((full_rows.state.alpha - full_cells.state.alpha).norm(), 1e-9 * full_cells.state.alpha.norm());
  EXPECT_NEAR(full_rows.state.sigma_theta_rad, full_cells.state.sigma_theta_rad,
              1e-9 * full_cells.state.sigma_theta_rad);

  MarginalOptions marginal;
  marginal.gradient_tolerance = 1e-9;
  const MarginalFit by_cells = solve_marginal(cells, full_cells.state, marginal);
  const MarginalFit by_rows = solve_marginal(rows, full_cells.state, marginal);
  ASSERT_EQ(by_cells.outcome, Outcome::converged) << by_cells.reason;
  ASSERT_EQ(by_rows.outcome, Outcome::converged) << by_rows.reason;
  EXPECT_NEAR(by_rows.marginal_nll, by_cells.marginal_nll, 1e-9 * std::abs(by_cells.marginal_nll));
  EXPECT_LT((by_rows.state.alpha - by_cells.state.alpha).norm(), 1e-9 * by_cells.state.alpha.norm());
  for (std::size_t l = 0; l < by_cells.state.landmarks.size(); ++l)
    EXPECT_LT((by_rows.state.landmarks[l] - by_cells.state.landmarks[l]).norm(),
              1e-9 * by_cells.state.landmarks[l].norm());
  EXPECT_NEAR(by_rows.state.sigma_theta_rad, by_cells.state.sigma_theta_rad, 1e-9);
}

TEST(Marginal, AWalkOfCorrelatedStepsIsCalibratedByItsOwnCovariance) {
  // Odometry whose steps err three times as much in one direction, and whose slip turns it: landmarks are
  // known as well as the covariance says, and worse where nothing but the sigmas of the same steps is told.
  testing::SceneOptions options{
      .stops = 20, .landmarks = 5, .repeats = 4, .sigma_s = 0.01, .sigma_heading = 0.01};
  options.walk = options.turns = options.shaped = true;
  const int repeats = 60;
  double chi_sq = 0.0, error_sq = 0.0, plain_sq = 0.0;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    testing::JointScene scene = make_scene("correlated steps", options, static_cast<std::uint64_t>(repeat));
    for (const bool shaped : {true, false}) {
      if (!shaped)
        for (StopPrior& prior : scene.problem.stops) prior.shape.reset();
      const MarginalFit fit =
          solve_marginal(scene.problem, position_seed(scene.problem, 2, NoiseLaw::f_squared));
      ASSERT_TRUE(is_usable(fit.outcome)) << repeat << ": " << fit.reason;
      ASSERT_TRUE(fit.covariance) << fit.covariance_reason;
      // Landmarks relative to the first one: where the path begins is the stops' own error.
      const int relative = 2 * (5 - 1);
      Eigen::MatrixXd to_first = Eigen::MatrixXd::Zero(relative, fit.covariance->rows());
      Eigen::VectorXd error(relative);
      for (int l = 1; l < 5; ++l) {
        to_first.block<2, 2>(2 * l - 2, 3 + 2 * l).setIdentity();
        to_first.block<2, 2>(2 * l - 2, 3) = -Eigen::Matrix2d::Identity();
        error.segment<2>(2 * l - 2) = fit.state.landmarks[l] - fit.state.landmarks[0] -
                                      scene.truth.landmarks[l] + scene.truth.landmarks[0];
      }
      if (shaped)
        chi_sq +=
            error.dot((to_first * *fit.covariance * to_first.transpose()).llt().solve(error)) / relative;
      (shaped ? error_sq : plain_sq) += error.squaredNorm();
    }
  }
  // Mean of chi-square over its 60 * 8 degrees of freedom: standard deviation sqrt(2 / 480) = 0.065; four of
  // them, and a tenth for what 100 cells leave of the sigmas.
  EXPECT_NEAR(chi_sq / repeats, 1.0, 0.26 + 0.1);
  EXPECT_LT(error_sq, 0.9 * plain_sq);
}

TEST(Marginal, SaysWhereTheStopsExplainOneNoise) {
  // One landmark from stops that may be 20 cm off: their errors explain ranges or bearings of a much better sensor, and the
  // likelihood draws a sigma to 0. The answer says so; where there is none it says why.
  int drawn = 0;
  for (int repeat = 0; repeat < 20; ++repeat) {
    const testing::JointScene scene =
        make_scene("drawn" + std::to_string(repeat),
                   {.stops = 20, .landmarks = 1, .law = NoiseLaw::f, .sigma_e = 0.05, .sigma_s = 0.2});
    const MarginalFit fit = solve_marginal(scene.problem, scene.truth);
    if (fit.reason.find("is drawn to 0 and held") == std::string::npos) {
      EXPECT_EQ(fit.outcome == Outcome::converged, fit.reason.empty()) << repeat << " " << fit.reason;
      continue;
    }
    ++drawn;
    EXPECT_TRUE(is_usable(fit.outcome)) << repeat << " " << fit.reason;
    EXPECT_LT(std::min(fit.state.noise.parameters[0] / 0.05,
                       fit.state.sigma_theta_rad / scene.truth.sigma_theta_rad),
              0.5);
  }
  EXPECT_GT(drawn, 0);
}

}  // namespace
}  // namespace rangecal
