// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/profile_limits.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double sigma_m = 0.005, sigma_theta_rad = 0.003;

/// Eight stops half a metre apart, four landmarks, six readings of each with y = d + u + e: u is one draw for
/// all of a cell.
Recording recording_with_shared_errors(double shared_m, std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  const Eigen::Vector2d axes[] = {{1.0, 1.5}, {3.0, -1.2}, {4.5, 2.0}, {-1.0, -1.0}};
  for (const char* label : {"a", "b", "c", "d"}) {
    recording.landmarks.emplace_back();
    recording.landmarks.back().label = label;
  }
  Random random(seed_from("recording_with_shared_errors", {seed}));
  for (int k = 0; k < 8; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = {0.5 * k, 0.0, 0.0};
    stop.sigma_xy_m = 0.002;
    recording.stops.push_back(stop);
    for (int l = 0; l < 4; ++l) {
      const Eigen::Vector2d v = axes[l] - Eigen::Vector2d(0.5 * k, 0.0);
      const double shared = random.normal(0.0, shared_m);
      for (int j = 0; j < 6; ++j)
        testing::add_reading(recording, k, l, j, v.norm() + shared + random.normal(0.0, sigma_m),
                             std::atan2(v.y(), v.x()) + random.normal(0.0, sigma_theta_rad));
    }
  }
  return recording;
}

JointState start() {
  JointState state;
  state.alpha = Eigen::Vector2d(0.0, 1.0);
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters = Eigen::VectorXd::Constant(1, sigma_m);
  state.sigma_theta_rad = sigma_theta_rad;
  state.landmarks = {{1.0, 1.5}, {3.0, -1.2}, {4.5, 2.0}, {-1.0, -1.0}};
  for (int k = 0; k < 8; ++k) state.stops.push_back({0.5 * k, 0.0, 0.0});
  return state;
}

/// The fit of a shared error, its limits set.
Fit fit_of(const Rows& rows) {
  const Effect* effect = find_effect("cell_effect");
  Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(effect->info().parameters.size()));
  p[0] = 0.005;
  Fit fit = refit(rows, {{effect, p}}, start(), {});
  add_profile_limits(rows, {}, fit);
  return fit;
}

/// How far the restricted NLL is above the fit's with the shared error held at `sigma`, all else refitted.
double rise_at(const Rows& rows, const Fit& fit, double sigma) {
  const auto at = [&](double value) {
    Model model = fit.model;
    model[0].parameters[0] = value;
    JointState state = fit.state;
    return restricted_nll(rows, model, {}, state);
  };
  return at(sigma) - at(fit.model[0].parameters[0]);
}

TEST(ProfileLimits, AreWhereTheNegativeLogLikelihoodHasRisenByHalfTheQuantileOfChiSquare) {
  const std::vector<Recording> recordings{recording_with_shared_errors(0.006, 1)};
  const Rows rows = make_rows(recordings);
  const Fit fit = fit_of(rows);
  ASSERT_TRUE(fit.ok);
  ASSERT_EQ(fit.limits.size(), fit.free.size());
  ASSERT_TRUE(fit.limits[0]);
  const double estimate = fit.model[0].parameters[0];
  EXPECT_LT(fit.limits[0]->low, estimate);
  EXPECT_GT(fit.limits[0]->high, estimate);
  EXPECT_NEAR(rise_at(rows, fit, fit.limits[0]->low), 1.9207, 0.03);
  EXPECT_NEAR(rise_at(rows, fit, fit.limits[0]->high), 1.9207, 0.03);
  // 32 cells less 2 of alpha, 8 of the landmarks and what the stops take: sigma / sqrt(2 nu), nu around 20.
  EXPECT_NEAR(std::sqrt(fit.covariance(0, 0)) / estimate, 1.0 / std::sqrt(40.0), 0.05);
}

TEST(ProfileLimits, OfAnEstimateAtZeroEndInItsOneSidedUpperLimit) {
  // Of the seeds some have cells that scatter less than their readings' own noise: there the estimate is 0.
  int at_zero = 0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const std::vector<Recording> recordings{recording_with_shared_errors(0.0, seed)};
    const Rows rows = make_rows(recordings);
    const Fit fit = fit_of(rows);
    ASSERT_TRUE(fit.ok && fit.limits[0]);
    EXPECT_LT(fit.limits[0]->high, 0.005);
    if (fit.model[0].parameters[0] > 1e-4) continue;
    ++at_zero;
    EXPECT_EQ(fit.limits[0]->low, 0.0);
    EXPECT_NEAR(rise_at(rows, fit, fit.limits[0]->high), 1.3528, 0.03);
  }
  EXPECT_GT(at_zero, 0);
}

TEST(ProfileLimits, CoverTheTruth) {
  int covered = 0;
  constexpr int trials = 100;
  for (std::uint64_t seed = 1; seed <= trials; ++seed) {
    const std::vector<Recording> recordings{recording_with_shared_errors(0.006, 100 + seed)};
    const Fit fit = fit_of(make_rows(recordings));
    ASSERT_TRUE(fit.ok && fit.limits[0]);
    covered += fit.limits[0]->low <= 0.006 && 0.006 <= fit.limits[0]->high;
  }
  EXPECT_GE(covered, 87);  // of Binomial(100, 0.95) fewer than 87 come once in a thousand
}

}  // namespace
}  // namespace rangecal::diagnosis
