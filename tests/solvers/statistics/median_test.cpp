// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/statistics/median.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace rangecal {
namespace {

TEST(UpperMedian, IsOneOfTheValues) {
  EXPECT_EQ(upper_median({5.0, -1.0, 3.0}), 3.0);
  EXPECT_EQ(upper_median({4.0, 1.0, 3.0, 2.0}), 3.0);  // not 2.5
  EXPECT_EQ(upper_median({2.0, 7.0}), 7.0);
  EXPECT_EQ(upper_median({2.0}), 2.0);
}

TEST(UpperMedian, LeavesWhatItIsGivenAlone) {
  const std::vector<double> values{9.0, 8.0, 7.0, 6.0, 5.0};
  EXPECT_EQ(upper_median(values), 7.0);
  EXPECT_EQ(values.front(), 9.0);
}

TEST(UpperMedian, OfNoneIsNoNumber) { EXPECT_TRUE(std::isnan(upper_median({}))); }

}  // namespace
}  // namespace rangecal
