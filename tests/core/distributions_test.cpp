// SPDX-License-Identifier: BSD-3-Clause
// Tails and quantiles against their closed forms.
#include "rangecal/core/distributions.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

TEST(Distributions, NormalQuantilesAreSymmetricAndReachFarOut) {
  EXPECT_NEAR(normal_quantile(0.975), z95, 1e-15);
  EXPECT_EQ(normal_quantile(0.5), 0.0);
  EXPECT_NEAR(normal_upper_quantile(0.025), z95, 1e-15);
  EXPECT_NEAR(0.5 * std::erfc(normal_upper_quantile(1e-300) / std::numbers::sqrt2), 1e-300, 1e-311);
}

TEST(Distributions, NormalBelowIsThatOfR) {
  EXPECT_EQ(normal_below(0.0), 0.5);
  // pnorm(1.96), pnorm(-6) of R: to the rounding of erfc and, far out, of z itself, z^2 as much.
  EXPECT_NEAR(normal_below(1.96), 0.9750021048517795, 4e-16);
  EXPECT_NEAR(normal_below(-6.0), 9.865876450376946e-10, 36.0 * 4e-16 * 9.865876450376946e-10);
  EXPECT_NEAR(normal_below(normal_quantile(0.3)), 0.3, 1e-15);
  EXPECT_GT(normal_below(-38.0), 0.0);
  EXPECT_EQ(normal_below(40.0), 1.0);
}

TEST(Distributions, BothTailsOfTheNormalAreTwiceOne) {
  EXPECT_EQ(normal_two_sided(0.0), 1.0);
  EXPECT_NEAR(normal_two_sided(z95), 0.05, 1e-16);
  for (const double z : {0.3, 1.96, 6.0, 37.0}) {
    EXPECT_EQ(normal_two_sided(z), 2.0 * normal_below(-z));
    EXPECT_EQ(normal_two_sided(-z), normal_two_sided(z));
  }
}

TEST(Distributions, TwoDegreesOfChiSquaredAreAnExponential) {
  for (const double x : {0.0, 0.3, 5.0, 80.0})
    EXPECT_NEAR(chi_squared_upper(x, 2.0), std::exp(-0.5 * x), 1e-14 * std::exp(-0.5 * x));
  EXPECT_NEAR(chi_squared_quantile(0.95, 2.0), -2.0 * std::log(0.05), 1e-12);
  EXPECT_NEAR(chi_squared_upper_quantile(1e-30, 2.0), 60.0 * std::numbers::ln10, 1e-11);
}

TEST(Distributions, OneDegreeOfChiSquaredIsASquaredNormal) {
  EXPECT_NEAR(chi_squared_quantile(0.95, 1.0), z95 * z95, 1e-13);
  EXPECT_NEAR(chi_squared_upper(z95 * z95, 1.0), 0.05, 1e-15);
}

TEST(Distributions, StudentsTOfOneAndTwoDegreesHaveClosedForms) {
  EXPECT_NEAR(student_t_quantile(0.975, 1.0), std::tan(0.475 * std::numbers::pi), 1e-12);
  EXPECT_NEAR(student_t_quantile(0.975, 2.0), 0.95 / std::sqrt(2.0 * 0.975 * 0.025), 1e-13);
  EXPECT_NEAR(student_t_quantile(0.975, 1e9), z95, 1e-8);
}

TEST(Distributions, FishersFOfTwoDegreesAboveHasAClosedForm) {
  // P(F > x) = (1 + 2 x / nu)^(-nu / 2) for 2 and nu degrees: x = 3, nu = 10 gives 1.6^-5
  EXPECT_NEAR(fisher_f_upper(3.0, 2.0, 10.0), std::pow(1.6, -5.0), 1e-15);
  EXPECT_EQ(fisher_f_upper(0.0, 5.0, 7.5), 1.0);
  EXPECT_NEAR(fisher_f_upper(2.0, 3.0, 1e9), chi_squared_upper(6.0, 3.0),
              1e-8);  // many below: chi-squared over 3
}

TEST(Distributions, WhatIsNoProbabilityIsRefused) {
  EXPECT_THROW(normal_quantile(1.5), std::domain_error);
  EXPECT_THROW(chi_squared_upper(1.0, 0.0), std::domain_error);
}

TEST(Distributions, LogGammaOfAHalfAndOfTen) {
  EXPECT_NEAR(log_gamma(0.5), 0.5 * std::log(std::numbers::pi), 1e-15);
  EXPECT_NEAR(log_gamma(10.0), std::log(362880.0), 1e-14);  // 9!
}

}  // namespace
}  // namespace rangecal
