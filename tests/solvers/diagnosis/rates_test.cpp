// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>

#include "diagnosis/rates.hpp"

namespace rangecal::diagnosis {
namespace {

TEST(Rates, TheSmallestOfManyIsOneLessThePowerOfTheRest) {
  // 1 - (1 - 0.01)^3 = 0.029701
  EXPECT_NEAR(std::exp(log_of_smallest(std::log(0.01), 3.0)), 0.029701, 1e-9);
  EXPECT_NEAR(log_of_smallest(-500.0, 100.0), -500.0 + std::log(100.0), 1e-12);  // n p far into the tail
  EXPECT_LE(log_of_smallest(0.0, 1e7), 0.0);
  // Both branches meet where they change over.
  EXPECT_NEAR(log_of_smallest(-29.999, 50.0), log_of_smallest(-30.001, 50.0) + 0.002, 1e-9);
}

TEST(Rates, AFamilyOfManyQuestionsTakesNoPowerFromAnother) {
  Rates rates;
  rates.families = 50.0;
  rates.within["offset"] = 1.0;
  const double before = rates.corrected("offset", std::log(1e-4));
  rates.within["period"] = 500.0;
  EXPECT_DOUBLE_EQ(rates.corrected("offset", std::log(1e-4)), before);
  EXPECT_NEAR(before, 1.0 - std::pow(1.0 - 1e-4, 50.0), 1e-12);
  // 500 questions of 1e-4 each: 1 - (1 - 1e-4)^500 = 0.04877; over 50 families 0.918.
  EXPECT_NEAR(std::exp(rates.in_family("period", std::log(1e-4))), 0.04877, 1e-5);
  EXPECT_NEAR(rates.corrected("period", std::log(1e-4)), 0.918, 1e-3);
  EXPECT_DOUBLE_EQ(rates.questions("period"), 25000.0);
}

TEST(Rates, AFamilyNeverSimulatedCountsAsOneQuestion) {
  Rates rates;
  EXPECT_DOUBLE_EQ(rates.starts("unheard of"), 1.0);
}

}  // namespace
}  // namespace rangecal::diagnosis
