// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/rates.hpp"

#include <gtest/gtest.h>

#include <cmath>

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

TEST(Rates, TheLogarithmOfACorrectedPValueDoesNotUnderflow) {
  Rates rates;
  rates.families = 50.0;
  EXPECT_NEAR(rates.log_corrected(-10.0), std::log(rates.corrected(-10.0)), 1e-12);
  EXPECT_NEAR(rates.log_corrected(-2000.0), -2000.0 + std::log(50.0), 1e-9);
  EXPECT_DOUBLE_EQ(rates.corrected(-2000.0), 0.0);
}

TEST(Rates, AFamilyNeverSimulatedCountsAsOneQuestion) {
  Rates rates;
  EXPECT_DOUBLE_EQ(rates.starts("unheard of"), 1.0);
}

TEST(Rates, ShortOfTheTailTheSimulatedLawIsTheCorrectedPValue) {
  Rates rates;
  rates.families = 10.0;
  for (int i = 1; i <= 100; ++i) rates.smallest.push_back(std::log(0.001 * i));  // ln 0.001 ... ln 0.1
  // 25 draws are as small as 0.025: (25 + 3 / 5) / 100. Halfway in ln p to the next, 25.5 are.
  EXPECT_NEAR(rates.corrected(std::log(0.025) + 1e-12), 0.256, 1e-9);
  EXPECT_NEAR(rates.corrected(0.5 * (std::log(0.025) + std::log(0.026))), 0.255 + 0.03 / std::sqrt(25.5),
              1e-9);
  EXPECT_DOUBLE_EQ(rates.corrected(0.0), 1.0);
  // The formula beyond 3 %, and 3 % where the two disagree.
  EXPECT_NEAR(rates.corrected(std::log(0.001)), 1.0 - std::pow(0.999, 10.0), 1e-12);
  double before = 0.0;
  for (double log_p = -12.0; log_p < 0.0; log_p += 0.01) {
    EXPECT_GE(rates.corrected(log_p), before);
    before = rates.corrected(log_p);
  }
}

TEST(Rates, AScalarTestIsJudgedByItsSimulatedLaw) {
  Rates rates;
  EXPECT_DOUBLE_EQ(rates.standardised("range_tail skew", 2.0), 2.0);
  rates.scalars["range_tail skew"] = {0.5, 2.0};
  EXPECT_DOUBLE_EQ(rates.standardised("range_tail skew", 2.0), 0.75);
  EXPECT_DOUBLE_EQ(rates.standardised("bearing_tail skew", 2.0), 2.0);
}

}  // namespace
}  // namespace rangecal::diagnosis
