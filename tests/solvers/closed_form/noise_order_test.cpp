// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/noise_order.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

/// Batches at distances 0.5 .. 4.5 m with y = d + sigma d^power e.
std::vector<std::vector<double>> batches_with(int power, double sigma, int size, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::vector<double>> batches;
  for (double d = 0.5; d < 4.6; d += 0.5) {
    batches.emplace_back();
    for (int k = 0; k < size; ++k) batches.back().push_back(d + sigma * std::pow(d, power) * random.normal());
  }
  return batches;
}

TEST(NoiseOrder, HandWorked) {
  // batch means 2 and 4; squared differences 0.04 + 0.04 and 0.16.
  // s = 1, unbiased: (1/2) [0.08/(2*2*4) + 0.16/(2*1*16)] = (1/2) [0.005 + 0.005] = 0.005
  // printed:         (1/2) [0.08/(2*3*4) + 0.16/(2*2*16)] = (1/2) [0.08/24 + 0.0025]
  const std::vector<std::vector<double>> batches{{1.9, 2.1, 1.9}, {3.8, 4.2}};
  std::vector<std::vector<double>> centred = batches;
  for (double& y : centred[0]) y += 2.0 - 5.9 / 3.0;
  const NoiseOrder order = noise_order(centred);
  ASSERT_EQ(order.outcome, Outcome::converged);
  EXPECT_NEAR(order.batch_mean_m[0], 2.0, 1e-12);
  EXPECT_NEAR(order.batch_mean_m[1], 4.0, 1e-12);
  EXPECT_NEAR(order.hypotheses[1].sigma_e_sq, 0.005, 1e-12);
  const NoiseOrder printed = noise_order(centred, DifferenceDivisor::printed);
  EXPECT_NEAR(printed.hypotheses[1].sigma_e_sq, 0.5 * (0.08 / 24.0 + 0.0025), 1e-12);
  // eq. 15 for s = 1: variances 4*0.005 = 0.02 and 16*0.005 = 0.08; squared deviations 0.08/3 and 0.08
  const double expected = -0.5 * (3 * std::log(2 * std::numbers::pi * 0.02) + (0.08 / 3.0) / 0.02 +
                                  2 * std::log(2 * std::numbers::pi * 0.08) + 0.08 / 0.08);
  EXPECT_NEAR(order.hypotheses[1].log_likelihood, expected, 1e-10);
}

TEST(NoiseOrder, FindsThePower) {
  for (int power = 0; power < 4; ++power) {
    const NoiseOrder order = noise_order(
        batches_with(power, 0.01, 100, seed_from("NoiseOrder.FindsThePower", {std::uint64_t(power)})));
    EXPECT_EQ(order.best_power, power);
    // 900 readings: the standard deviation of the difference estimate of sigma^2 is sqrt(3/900) = 6 %; four
    // of them
    EXPECT_NEAR(order.hypotheses[power].sigma_e_sq, 1e-4, 0.24e-4);
  }
}

TEST(NoiseOrder, UnbiasedDivisorIsUnbiasedAndThePrintedOneLow) {
  // batches of 4: the printed divisor is low by 3/4. 2000 repeats of 9 batches: about 0.6 % standard error
  double unbiased = 0.0, printed = 0.0;
  for (std::uint64_t repeat = 0; repeat < 2000; ++repeat) {
    const auto batches = batches_with(0, 0.02, 4, seed_from("NoiseOrder.Divisor", {repeat}));
    unbiased += noise_order(batches).hypotheses[0].sigma_e_sq / 2000;
    printed += noise_order(batches, DifferenceDivisor::printed).hypotheses[0].sigma_e_sq / 2000;
  }
  EXPECT_NEAR(unbiased / 4e-4, 1.0, 0.03);
  EXPECT_NEAR(printed / 4e-4, 0.75, 0.025);
}

TEST(NoiseOrder, DegenerateDataIsNamed) {
  EXPECT_EQ(noise_order(std::vector<std::vector<double>>{{1.0, 1.1}, {2.0}}).outcome, Outcome::too_few_data);
  EXPECT_EQ(noise_order(std::vector<std::vector<double>>{{1.0, 1.0}, {2.0, 2.0}}).outcome, Outcome::failed);
  EXPECT_EQ(noise_order(Pairs{}).outcome, Outcome::too_few_data);
}

TEST(NoiseOrder, NormalisedDifferences) {
  // (2.2 - 2.0) / 2^2 = 0.05, (1.8 - 2.2) / 4 = -0.1
  const std::vector<double> differences = normalised_differences(std::vector<double>{2.0, 2.2, 1.8}, 2.0, 2);
  ASSERT_EQ(differences.size(), 2u);
  EXPECT_NEAR(differences[0], 0.05, 1e-12);
  EXPECT_NEAR(differences[1], -0.1, 1e-12);
}

}  // namespace
}  // namespace rangecal
