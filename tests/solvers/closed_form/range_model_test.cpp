// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/range_model.hpp"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "closed_form/moments.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

constexpr double range_noise_m = 0.01, stop_error_m = 0.01;

/// Five sights from each of `stops` stops along a line, whose errors they share.
std::vector<RangeSample> sights_of_stops(int stops) {
  Random random(seed_from("sights of stops"));
  std::vector<RangeSample> samples;
  for (int k = 0; k < stops; ++k) {
    const Eigen::Vector2d error(stop_error_m * random.normal(), stop_error_m * random.normal());
    for (int l = 0; l < 5; ++l) {
      RangeSample s;
      s.d = random.uniform(0.5, 5.0);
      const double angle = random.uniform(-3.0, 3.0);
      s.u = Eigen::Vector2d(std::cos(angle), std::sin(angle));
      s.y = 0.05 + 0.9 * (s.d - s.u.dot(error)) + range_noise_m * random.normal();
      s.d_variance = stop_error_m * stop_error_m;
      s.stop = k;
      s.landmark = l;
      samples.push_back(s);
    }
  }
  return samples;
}

TEST(RangeModel, SightsOfOneStopShareItsError) {
  const std::vector<RangeSample> samples = sights_of_stops(12);
  ClosedFormOptions options;
  options.noise_law = NoiseLaw::constant;
  const RangeModel model = fit_range_model(samples, RangeWeighting::ordinary, {}, 1, options);
  ASSERT_EQ(model.outcome, Outcome::converged) << model.reason;
  ASSERT_TRUE(model.noise_estimates[0].std_dev);
  // The squared correlations of the residuals of a stop, pair by pair.
  const double sigma = model.noise.parameters[0], other = std::pow(model.alpha[1] * stop_error_m, 2);
  const double total = sigma * sigma + other;
  std::vector<MomentTerm> terms;
  double shared = 0.0;
  for (std::size_t i = 0; i < samples.size(); ++i) {
    terms.push_back({std::pow(samples[i].y - evaluate_polynomial(model.alpha, samples[i].d), 2), 1.0, other});
    for (std::size_t j = i + 1; j < samples.size(); ++j)
      if (samples[j].stop == samples[i].stop)
        shared += std::pow(other / total * samples[i].u.dot(samples[j].u), 2);
  }
  EXPECT_GT(shared, 1.0);
  const double expected = std_dev_from_moments(terms, shared, 0.0, 60.0 - 2.0, sigma * sigma) / (2.0 * sigma);
  EXPECT_NEAR(*model.noise_estimates[0].std_dev, expected, 1e-10 * expected);
}

TEST(RangeModel, ManySightsFromOneStopCostOnePass) {
  // Pairs are that. Pair by pair 200 000 of them would be 2e10 terms, some minutes; one pass takes a tenth of
  // a second.
  Random random(seed_from("many sights"));
  std::vector<RangeSample> samples(200000);
  for (RangeSample& s : samples) {
    s.d = random.uniform(0.5, 5.0);
    s.y = 0.05 + 0.9 * s.d + range_noise_m * random.normal();
  }
  ClosedFormOptions options;
  options.noise_law = NoiseLaw::constant;
  const auto begin = std::chrono::steady_clock::now();
  const RangeModel model = fit_range_model(samples, RangeWeighting::ordinary, {}, 1, options);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  ASSERT_EQ(model.outcome, Outcome::converged) << model.reason;
  // sigma / sqrt(2 (N - 2)): nothing is shared where the distances are exact.
  const double sigma = model.noise.parameters[0];
  EXPECT_NEAR(*model.noise_estimates[0].std_dev, sigma / std::sqrt(2.0 * 199998.0), 1e-9 * sigma);
}

}  // namespace
}  // namespace rangecal
