// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <map>
#include <string>

#include "rangecal/core/recording.hpp"

namespace rangecal {
namespace {

std::string words_of(const std::map<std::string, int>& dropped) {
  Counts counts;
  for (const auto& [reason, count] : dropped) counts.dropped[reason] = count;
  return dropped_in_words(counts);
}

TEST(Counts, ReasonsStandTheMostFrequentFirst) {
  EXPECT_EQ(words_of({{"missing", 2}, {"negative", 30}, {"zero", 7}}), "30 negative, 7 zero, 2 missing");
}

TEST(Counts, EqualCountsStandInTheOrderOfTheirReasons) {
  EXPECT_EQ(words_of({{"zero", 2}, {"missing", 2}, {"negative", 2}, {"above range_max_m", 3}}),
            "3 above range_max_m, 2 missing, 2 negative, 2 zero");
}

TEST(Counts, WhatWasNotDroppedIsNotNamed) {
  EXPECT_EQ(words_of({}), "");
  EXPECT_EQ(words_of({{"zero", 0}}), "");
  EXPECT_EQ(words_of({{"missing", 0}, {"zero", 1}}), "1 zero");
}

}  // namespace
}  // namespace rangecal
