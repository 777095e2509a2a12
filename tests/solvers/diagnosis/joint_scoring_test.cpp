// SPDX-License-Identifier: BSD-3-Clause
// Curve, noise, effects and tails of known distances fitted together: the score of the likelihood, written down here anew, is
// zero where the fit ends.
#include "diagnosis/joint_scoring.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"
#include "solvers/diagnosis/expect_optimum.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/state_of_pairs.hpp"

namespace rangecal::diagnosis {
namespace {

/// 150 known distances read twice: f = 0.05 + 0.95 d + 0.02 d^2, s = 0.004 f^2, 4 mm per kelvin, and `late` of the readings
/// further by an exponential of mean 0.2 m.
Recording late_and_warm(double late, const std::string& name) {
  Random random(seed_from(name));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  for (int i = 0; i < 300; ++i) {
    const double d = 1.0 + 0.02 * (i / 2), f = 0.05 + d * (0.95 + 0.02 * d),
                 kelvin = random.uniform(-10.0, 10.0);
    const double echo = random.uniform() < late ? -0.2 * std::log(random.uniform()) : 0.0;
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(f + 0.004 * kelvin + 0.004 * f * f * random.normal() + echo);
    recording.pairs.covariates["temperature_c"].push_back(20.0 + kelvin);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

/// alpha_0, alpha_1, alpha_2, a [m/K], s [1/K], share, mean of the late ones [m], ln sigma.
using Parameters = std::array<double, 8>;

/// NLL of the readings [nats], whose rounding to steps adds step^2 / 12 to s^2, ln((1 - p) N(e; 0, s^2) + p EMG(e; s, tau)) each.
double nll_of(const Recording& recording, double reference_c, const Parameters& x, double step_m = 0.0) {
  double sum = 0.0;
  const Pairs& pairs = recording.pairs;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double d = pairs.true_m[i], f = x[0] + d * (x[1] + d * x[2]),
                 s = std::sqrt(std::exp(2.0 * x[7]) * std::pow(f, 4) + step_m * step_m / 12.0);
    const double warmer = pairs.covariates.at("temperature_c")[i] - reference_c;
    const double e = pairs.reading_m[i] - f - (x[3] + x[4] * d) * warmer, tau = x[6];
    const double body = std::exp(-0.5 * e * e / (s * s) - half_log_two_pi) / s;
    const double late = std::exp(s * s / (2.0 * tau * tau) - e / tau) *
                        std::erfc((s / tau - e / s) / std::sqrt(2.0)) / (2.0 * tau);
    sum -= std::log((1.0 - x[5]) * body + x[5] * late);
  }
  return sum;
}

/// Expects a fit of warmth and late readings, the last two of its model, to have that NLL, within
/// `above`, and to be an optimum of it.
void expect_likeliest(const Recording& recording, const Fit& fit, double above, double step_m = 0.0) {
  ASSERT_TRUE(fit.ok);
  const Eigen::VectorXd &of_warm = fit.model.rbegin()[1].parameters, &of_late = fit.model.back().parameters;
  const Parameters found{
      fit.state.alpha[0], fit.state.alpha[1], fit.state.alpha[2], of_warm[0],
      of_warm[1],         of_late[0],         of_late[1],         std::log(fit.state.noise.parameters[0])};
  const auto nll = [&](const Parameters& x) { return nll_of(recording, of_warm[2], x, step_m); };
  EXPECT_NEAR(fit.nll, nll(found), above);  // tails' own value, an upper bound at the last weights
  const std::vector<double> steps{1e-4, 1e-4, 1e-5, 1e-6, 1e-6, 1e-4, 1e-4};  // ln sigma is REML's
  testing::expect_optimum(nll, found, steps, 0.1);
}

TEST(JointScoring, EndsWhereTheScoreIsZero) {
  const Recording recording = late_and_warm(0.15, "JointScoring.Ends");
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  ASSERT_TRUE(rows.sequence.empty());
  const Effect *warm = find_effect("temperature_coefficient:temperature_c"),
               *late = find_effect("late_return");
  ASSERT_TRUE(warm && late);
  const Model start{{warm, warm->start_grid(rows.context).front()}, {late, Eigen::Vector2d(0.04, 0.5)}};
  const JointState near =
      testing::state_of_pairs(rows, Eigen::Vector3d(0.06, 0.94, 0.021), NoiseLaw::f_squared, 0.01);
  ASSERT_TRUE(is_scored_jointly(rows, start, near, {}));
  expect_likeliest(recording, refit(rows, start, near, {}), 0.01);
}

/// Of readings on a grid each with a distance of its own.
TEST(JointScoring, EndsWhereTheScoreIsZeroBesideAGrid) {
  constexpr double step_m = 0.02;
  Recording recording = late_and_warm(0.15, "JointScoring.Grid");
  for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
    recording.pairs.true_m[i] += 1e-4 * static_cast<double>(i % 2);  // no repeats
    recording.pairs.reading_m[i] = step_m * std::round(recording.pairs.reading_m[i] / step_m);
  }
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  ASSERT_EQ(static_cast<std::size_t>(rows.cell_count), rows.size());
  const Effect *warm = find_effect("temperature_coefficient:temperature_c"),
               *late = find_effect("late_return"), *grid = find_effect("quantisation");
  ASSERT_TRUE(warm && late && grid);
  const Model start{{grid, Eigen::Vector2d(0.0, step_m)},
                    {warm, warm->start_grid(rows.context).front()},
                    {late, Eigen::Vector2d(0.04, 0.5)}};
  const JointState near =
      testing::state_of_pairs(rows, Eigen::Vector3d(0.06, 0.94, 0.021), NoiseLaw::f_squared, 0.01);
  ASSERT_TRUE(is_scored_jointly(rows, start, near, {}));
  expect_likeliest(recording, refit(rows, start, near, {}), 0.02, step_m);
}

/// NLL of errors that wander [nats], the rows in their order in time: x = alpha_0 .. alpha_2, rho, q, ln sigma. With V_ij = q rho^|i-j| off its
/// diagonal of ones and z = e / s: sum ln s_i + (z^T V^-1 z + ln det V + n ln 2 pi) / 2.
double nll_of_wandering(const Recording& recording, const std::array<double, 6>& x) {
  const auto n = static_cast<Eigen::Index>(recording.pairs.size());
  Eigen::VectorXd z(n);
  Eigen::MatrixXd V(n, n);
  double sum = 0.0;
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const double d = recording.pairs.true_m[at], f = x[0] + d * (x[1] + d * x[2]), s = std::exp(x[5]) * f;
    z[i] = (recording.pairs.reading_m[at] - f) / s;
    sum += std::log(s) + half_log_two_pi;
    for (Eigen::Index j = 0; j < n; ++j)
      V(i, j) = i == j ? 1.0 : x[4] * std::pow(x[3], std::abs(static_cast<double>(i - j)));
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(V);
  const Eigen::VectorXd white = factor.matrixL().solve(z);
  const double log_det = 2.0 * Eigen::VectorXd(factor.matrixLLT().diagonal()).array().log().sum();
  return sum + 0.5 * (white.squaredNorm() + log_det);
}

TEST(JointScoring, FindsWhatWandersTogetherWithTheCurve) {
  const Recording recording = testing::wandering_pairs(
      {.readings = 400, .sigma = 0.02, .wanders = 0.6, .rho = 0.8}, "JointScoring.Wandering");
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  ASSERT_FALSE(rows.sequence.empty());
  const Model start{{find_effect("autocorrelated_noise"), Eigen::Vector3d(0.3, 0.0, 0.3)}};
  const JointState near =
      testing::state_of_pairs(rows, Eigen::Vector3d(0.06, 0.94, 0.021), NoiseLaw::f, 0.03);
  ASSERT_TRUE(is_scored_jointly(rows, start, near, {}));
  const Fit fit = refit(rows, start, near, {});
  ASSERT_TRUE(fit.ok);
  const Eigen::VectorXd& wanders = fit.model[0].parameters;
  const std::array<double, 6> found{fit.state.alpha[0], fit.state.alpha[1],
                                    fit.state.alpha[2], wanders[0],
                                    wanders[2],         std::log(fit.state.noise.parameters[0])};
  std::vector<double> steps;
  for (std::size_t j = 0; j + 1 < found.size(); ++j)  // ln sigma is REML's
    steps.push_back(1e-4 * (j < 3 ? 0.1 : 1.0) * std::max(0.1, std::abs(found[j])));
  testing::expect_optimum([&](const std::array<double, 6>& x) { return nll_of_wandering(recording, x); },
                          found, steps, 0.2);
}

TEST(JointScoring, IsNotForErrorsSharedByCells) {
  const Recording recording = late_and_warm(0.0, "JointScoring.Shared");
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const JointState near =
      testing::state_of_pairs(rows, Eigen::Vector3d(0.06, 0.94, 0.021), NoiseLaw::f_squared, 0.01);
  const Model shared{{find_effect("autocorrelated_noise"), Eigen::Vector3d(0.5, 0.0, 1.0)}};
  EXPECT_FALSE(is_scored_jointly(rows, shared, near, {}));
  RefitOptions held;
  held.held.alpha = held.held.sigmas = true;
  EXPECT_FALSE(is_scored_jointly(rows, {}, near, held));
}

}  // namespace
}  // namespace rangecal::diagnosis
