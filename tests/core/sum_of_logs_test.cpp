// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/sum_of_logs.hpp"

#include <gtest/gtest.h>

#include <limits>

namespace rangecal {
namespace {

TEST(SumOfLogs, IsThePlainSumWhereThatHasNumbers) {
  // log(0.2 + 0.6) = log 0.8, of which 0.6 is three quarters.
  const SumOfLogs sum = sum_of_logs(std::log(0.2), std::log(0.6));
  EXPECT_NEAR(sum.log_sum, std::log(0.8), 1e-15);
  EXPECT_NEAR(sum.part, 0.75, 1e-15);
  EXPECT_NEAR(sum_of_logs(std::log(0.6), std::log(0.2)).part, 0.25, 1e-15);
}

TEST(SumOfLogs, IsTheLargerTermWhereExponentialsHaveNoNumbers) {
  EXPECT_EQ(sum_of_logs(-5000.0, -4000.0).log_sum, -4000.0);
  EXPECT_EQ(sum_of_logs(-5000.0, -4000.0).part, 1.0);
  EXPECT_EQ(sum_of_logs(-4000.0, -5000.0).part, 0.0);
  EXPECT_EQ(sum_of_logs(-1.0, -std::numeric_limits<double>::infinity()).log_sum, -1.0);
}

TEST(SumOfLogs, OfNoNumberIsNone) {
  const double none = std::numeric_limits<double>::quiet_NaN();
  EXPECT_TRUE(std::isnan(sum_of_logs(none, -1.0).log_sum));
  EXPECT_TRUE(std::isnan(sum_of_logs(-1.0, none).log_sum));
}

}  // namespace
}  // namespace rangecal
