// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/angles.hpp"

#include <gtest/gtest.h>

namespace rangecal {
namespace {

constexpr double half_turn = std::numbers::pi;

TEST(Arc, IsTheShortestThatHoldsTheAngles) {
  EXPECT_EQ(arc_of({0.5, -0.25, 0.1}), std::pair(-0.25, 0.5));
  // 3 and -3 are 0.28 rad apart, across 180 degrees
  const auto behind = arc_of({-3.0, 3.0, 3.1});
  EXPECT_EQ(behind, std::pair(3.0, -3.0));
  for (const double on : {3.0, half_turn, -3.0, 3.0 - 2.0 * half_turn})
    EXPECT_TRUE(is_on_arc(on, behind)) << on;
  for (const double off : {2.99, 0.0, -2.99}) EXPECT_FALSE(is_on_arc(off, behind)) << off;
  const auto point = arc_of({1.0, 1.0});
  EXPECT_TRUE(is_on_arc(1.0, point));
  EXPECT_FALSE(is_on_arc(1.001, point));
}

TEST(Arc, IsTheCircleWhereNoGapIsWiderThan45Degrees) {
  std::vector<double> each_40;
  for (int i = 0; i < 9; ++i) each_40.push_back(i * 40.0 * half_turn / 180.0);
  EXPECT_EQ(arc_of(each_40), std::pair(-half_turn, half_turn));
  EXPECT_TRUE(is_on_arc(0.3, arc_of(each_40)));
  each_40.erase(each_40.begin() + 2);  // 80 degrees: the gap is from 40 to 120
  EXPECT_FALSE(is_on_arc(80.0 * half_turn / 180.0, arc_of(each_40)));
  EXPECT_TRUE(is_on_arc(140.0 * half_turn / 180.0, arc_of(each_40)));
}

}  // namespace
}  // namespace rangecal
