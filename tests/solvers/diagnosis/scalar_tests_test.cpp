// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/scalar_tests.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace rangecal::diagnosis {
namespace {

double central_moment(const std::vector<double>& values, int power) {
  double mean = 0.0, sum = 0.0;
  for (double x : values) mean += x / static_cast<double>(values.size());
  for (double x : values) sum += std::pow(x - mean, power);
  return sum / static_cast<double>(values.size());
}

TEST(ScalarTests, SkewnessAsSciPyHasIt) {
  // scipy.stats.skewtest([2, 8, 0, 4, 1, 9, 9, 0]) of SciPy's reference: statistic 0.44626385374196975
  const std::vector<double> values = {2, 8, 0, 4, 1, 9, 9, 0};
  const double skewness = central_moment(values, 3) / std::pow(central_moment(values, 2), 1.5);
  EXPECT_NEAR(skewness_z(skewness, 8.0), 0.44626385374196975, 1e-12);
  EXPECT_DOUBLE_EQ(skewness_z(-skewness, 8.0), -skewness_z(skewness, 8.0));
}

TEST(ScalarTests, KurtosisAsSciPyHasIt) {
  // scipy.stats.kurtosistest(list(range(20))) of SciPy's reference: statistic -1.7058104152122062
  std::vector<double> values;
  for (int i = 0; i < 20; ++i) values.push_back(i);
  const double kurtosis = central_moment(values, 4) / std::pow(central_moment(values, 2), 2);
  EXPECT_NEAR(kurtosis_z(kurtosis, 20.0), -1.7058104152122062, 1e-12);
}

}  // namespace
}  // namespace rangecal::diagnosis
