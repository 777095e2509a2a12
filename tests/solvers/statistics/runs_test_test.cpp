// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/statistics/runs_test.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

TEST(RunsTest, ExactHandWorked) {
  // median 3.5: --- +++ , n1 = n2 = 3, r = 2. C(6,3) = 20; P(r=2) = 2*1*1/20 = 0.1; two-sided p = 0.2
  const std::vector<double> values{1, 2, 3, 4, 5, 6};
  const RunsTest test = runs_test(values);
  EXPECT_EQ(test.outcome, Outcome::converged);
  EXPECT_TRUE(test.exact);
  EXPECT_EQ(test.runs, 2);
  EXPECT_EQ(test.above, 3);
  EXPECT_EQ(test.below, 3);
  EXPECT_DOUBLE_EQ(test.expected_runs, 4.0);
  EXPECT_NEAR(test.p_value, 0.2, 1e-12);
}

TEST(RunsTest, ExactOddNumberOfRuns) {
  // median 2.5: signs - + + - ; n1 = n2 = 2, r = 3. C(4,2) = 6; P(2) = 2/6, P(3) = (1*1 + 1*1)/6 = 2/6, P(4)
  // = 2/6. P(r <= 3) = P(r >= 3) = 4/6, p = min(1, 8/6) = 1
  const std::vector<double> values{1, 3, 4, 2};
  const RunsTest test = runs_test(values);
  EXPECT_EQ(test.runs, 3);
  EXPECT_DOUBLE_EQ(test.p_value, 1.0);
}

TEST(RunsTest, NormalHandWorked) {
  // six values as above: var = 2*9*(18-6)/(36*5) = 1.2, z = (2-4)/sqrt(1.2) = -1.8257419; p =
  // erfc(1.8257419/sqrt 2)
  const std::vector<double> values{1, 2, 3, 4, 5, 6};
  const RunsTest test = runs_test(values, RunsDistribution::normal);
  EXPECT_FALSE(test.exact);
  EXPECT_NEAR(test.z, -2.0 / std::sqrt(1.2), 1e-12);
  EXPECT_NEAR(test.p_value, 0.0678892, 1e-6);
}

TEST(RunsTest, ValuesAtTheMedianAreLeftOutAndCounted) {
  const std::vector<double> values{1, 3, 2, 2, 2, 1, 3};
  const RunsTest test = runs_test(values);
  EXPECT_EQ(test.at_median, 3);
  EXPECT_EQ(test.runs, 4);
}

TEST(RunsTest, DegenerateDataIsNamed) {
  const std::vector<double> same(10, 1.0);
  EXPECT_EQ(runs_test(same).outcome, Outcome::too_few_data);
  EXPECT_EQ(runs_test({}).outcome, Outcome::too_few_data);
  const std::vector<double> bad{1.0, std::nan("")};
  EXPECT_THROW(runs_test(bad), InputError);
}

TEST(RunsTest, FalseAlarmsAtTheLevelOnIndependentData) {
  // 1000 batches of 60: at level 0.05 the discrete exact test rejects at most 5 %: 50 + 4 sqrt(47.5) = 78
  int alarms = 0;
  for (std::uint64_t batch = 0; batch < 1000; ++batch) {
    Random random(seed_from("RunsTest.FalseAlarms", {batch}));
    std::vector<double> values(60);
    for (double& value : values) value = random.normal();
    if (runs_test(values).p_value < 0.05) ++alarms;
  }
  EXPECT_LE(alarms, 78);
  EXPECT_GE(alarms, 15);
}

TEST(RunsTest, FindsADrift) {
  Random random(seed_from("RunsTest.FindsADrift"));
  std::vector<double> values(200);
  for (std::size_t k = 0; k < values.size(); ++k) values[k] = random.normal() + 0.03 * static_cast<double>(k);
  EXPECT_LT(runs_test(values).p_value, 1e-6);
  EXPECT_LT(runs_test(values).z, 0.0);
}

}  // namespace
}  // namespace rangecal
