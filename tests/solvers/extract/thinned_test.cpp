// SPDX-License-Identifier: BSD-3-Clause
#include "extract/thinned.hpp"

#include <gtest/gtest.h>

namespace rangecal {
namespace {

std::vector<int> kept_of(int count) {
  Thinned<int> thinned(400);
  for (int i = 0; i < count; ++i)
    if (thinned.next()) thinned.keep(i);
  return thinned.kept();
}

TEST(Thinned, KeepsAllOfFewAndAnEvenChoiceOfMany) {
  EXPECT_TRUE(kept_of(0).empty());
  EXPECT_EQ(kept_of(399).size(), 399u);
  for (const auto& [count, step] : {std::pair{400, 2}, {798, 2}, {799, 4}, {10'000, 32}}) {
    const std::vector<int> kept = kept_of(count);
    ASSERT_EQ(static_cast<int>(kept.size()), (count + step - 1) / step) << count;
    for (std::size_t i = 0; i < kept.size(); ++i) EXPECT_EQ(kept[i], step * static_cast<int>(i)) << count;
  }
}

}  // namespace
}  // namespace rangecal
