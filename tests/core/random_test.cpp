// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/random.hpp"

#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <set>
#include <vector>

namespace rangecal {
namespace {

TEST(Random, SeedsDifferByNameAndByIndex) {
  std::set<std::uint64_t> seeds;
  for (std::uint64_t i = 0; i < 100; ++i) {
    for (std::uint64_t j = 0; j < 100; ++j) seeds.insert(seed_from("name", {i, j}));
  }
  seeds.insert(seed_from("name"));
  seeds.insert(seed_from("name", {0}));
  seeds.insert(seed_from("eman", {0}));
  EXPECT_EQ(seeds.size(), 10003u);
  EXPECT_EQ(seed_from("name", {1, 2}), seed_from("name", {1, 2}));
  EXPECT_NE(seed_from("name", {1, 2}), seed_from("name", {2, 1}));
}

TEST(Random, OneInputBitMovesHalfOfTheSeed) {
  // 64 output bits, each moved with probability 1/2: mean 32, deviation 4; the mean over 64 flips has deviation 0.5.
  double moved = 0.0;
  for (int bit = 0; bit < 64; ++bit) {
    moved += std::popcount(seed_from("case", {0}) ^ seed_from("case", {std::uint64_t{1} << bit}));
  }
  EXPECT_NEAR(moved / 64.0, 32.0, 5 * 0.5);
}

TEST(Random, NormalHasItsMoments) {
  Random random(seed_from("Random.NormalHasItsMoments"));
  const int n = 200000;
  double sum = 0.0, squares = 0.0, fourths = 0.0;
  for (int i = 0; i < n; ++i) {
    const double x = random.normal();
    sum += x;
    squares += x * x;
    fourths += x * x * x * x;
  }
  // Deviations of the three means: 1/sqrt n, sqrt(2/n), sqrt(96/n) (the variances of x, x^2 and x^4 are 1, 2, 96).
  EXPECT_NEAR(sum / n, 0.0, 4.0 / std::sqrt(n));
  EXPECT_NEAR(squares / n, 1.0, 4.0 * std::sqrt(2.0 / n));
  EXPECT_NEAR(fourths / n, 3.0, 4.0 * std::sqrt(96.0 / n));
}

TEST(Random, UniformAndIndexFillTheirRangeEvenly) {
  Random random(seed_from("Random.UniformAndIndexFillTheirRangeEvenly"));
  const int n = 70000;
  std::vector<int> counts(7), bins(7);
  for (int i = 0; i < n; ++i) {
    ++counts[random.index(7)];
    const double u = random.uniform();
    ASSERT_GE(u, 0.0);
    ASSERT_LT(u, 1.0);
    ++bins[static_cast<std::size_t>(7.0 * u)];
  }
  // Binomial(n, 1/7): deviation sqrt(n 6/49) = 92.6.
  for (int i = 0; i < 7; ++i) {
    EXPECT_NEAR(counts[i], n / 7.0, 5 * 92.6);
    EXPECT_NEAR(bins[i], n / 7.0, 5 * 92.6);
  }
  EXPECT_EQ(random.index(1), 0u);
  EXPECT_EQ(random.index(0), 0u);
}

TEST(Random, SameNumbersOnEveryMachine) {
  // mt19937_64 is fixed by the standard: its 10000th number from the default seed 5489 is 9981545732273789042.
  Random random(5489);
  for (int i = 1; i < 10000; ++i) random.bits();
  EXPECT_EQ(random.bits(), 9981545732273789042ULL);
}

}  // namespace
}  // namespace rangecal
