// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/proportion.hpp"

#include <gtest/gtest.h>

namespace rangecal::test {
namespace {

TEST(Wilson, ByHand) {
  // 8 of 10, z = 1.96: centre (0.8 + 0.19207) / 1.38415 = 0.71674, half (1.96 sqrt(0.016 + 0.0096036)) / 1.38415 = 0.22658
  const auto [low, high] = wilson(8, 10);
  EXPECT_NEAR(low, 0.4902, 1e-3);
  EXPECT_NEAR(high, 0.9433, 1e-3);
  EXPECT_EQ(wilson(0, 0).second, 1.0);
  EXPECT_NEAR(wilson(0, 300).second, 3.8415 / 303.8415, 1e-4);  // z^2 / (n + z^2)
}

}  // namespace
}  // namespace rangecal::test
