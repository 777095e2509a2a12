// SPDX-License-Identifier: BSD-3-Clause
// The covariance of the curve and the effects' parameters together, as diagnose hands it to `correct`.
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

/// 240 readings y = f(d) + 0.1 theta (T - 20) d + noise of 0.5 %, the effect range_scale by temperature, T from 10 to 40: not
/// about 20, so that theta and the slope of f hang together.
Recording in_the_warmth(double theta) {
  Random random(seed_from("EffectsCovariance"));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  for (int i = 0; i < 240; ++i) {
    const double d = random.uniform(0.5, 4.0), T = random.uniform(10.0, 40.0), f = 0.05 + 0.95 * d;
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(f + 0.1 * theta * (T - 20.0) * d + 0.005 * f * f * random.normal());
    recording.pairs.covariates["temperature_c"].push_back(T);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

TEST(EffectsCovariance, IsThatOfTheRegressionOnCurveAndEffect) {
  const Recording recording = in_the_warmth(0.02);
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.null_draws = 50;
  options.force = {{"range_scale"}};
  const Calibration c = diagnose({&recording, 1}, options).corrected;
  ASSERT_EQ(c.effects.count("range_scale"), 1u);
  EXPECT_NEAR(c.effects.at("range_scale").at("scale"), 0.02, 0.002);
  ASSERT_EQ(c.effects_range.size(), 1u);  // the one column that the effect uses
  const std::vector<double>& warmth = recording.pairs.covariates.at("temperature_c");
  EXPECT_EQ(c.effects_range.at("temperature_c"), std::pair(*std::min_element(warmth.begin(), warmth.end()),
                                                           *std::max_element(warmth.begin(), warmth.end())));
  ASSERT_TRUE(c.effects_covariance);
  ASSERT_EQ(c.effects_covariance->parameters, std::vector<std::string>{"range_scale.scale"});
  // Weighted least squares on 1, d, .., d^n and x = 0.1 (T - 20) d. Left out is what the spread says of f, some
  // 8 s^2 / f^2 < 1 % of the information, and that P was taken a step of less than 1e-3 nats before the end.
  const Eigen::Index alphas = c.alpha.size();
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(alphas + 1, alphas + 1);
  for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
    const double d = recording.pairs.true_m[i];
    const double s = c.noise.spread(d, evaluate_polynomial(c.alpha, d));
    Eigen::VectorXd row(alphas + 1);
    row << powers_of(d, alphas), 0.1 * (recording.pairs.covariates.at("temperature_c")[i] - 20.0) * d;
    information += row * row.transpose() / (s * s);
  }
  const Eigen::MatrixXd expected = information.inverse(), &stated = c.effects_covariance->matrix;
  ASSERT_EQ(stated.rows(), alphas + 1);
  for (Eigen::Index i = 0; i <= alphas; ++i)
    for (Eigen::Index j = 0; j <= alphas; ++j)
      EXPECT_NEAR(stated(i, j), expected(i, j), 0.06 * std::sqrt(expected(i, i) * expected(j, j)))
          << i << " " << j;
  EXPECT_LT(expected(1, alphas), -0.1 * std::sqrt(expected(1, 1) * expected(alphas, alphas)));
  EXPECT_EQ(*c.alpha_covariance, stated.topLeftCorner(alphas, alphas))
      << "the errors of the effect are in the curve's";
  EXPECT_EQ(c.covariance_reason, "");
}

}  // namespace
}  // namespace rangecal
