// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/noise_shape.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

NoiseShapeParameters student_t(double nu) { return {NoiseShape::student_t, nu, 0.1, 10.0}; }

TEST(ContaminatedDensity, IsThePlainFormulaWhereThatHasNumbers) {
  // Rounding of a sum of logarithms of size up to 57: 1e-14 of 1 and of it.
  for (const double k : {1.0, 1.5, 3.0, 30.0})
    for (const double p : {1e-4, 0.1, 0.49})
      for (double z = -10.0; z <= 10.0; z += 0.5) {
        const double body = (1.0 - p) * std::exp(-0.5 * z * z),
                     wide = p / k * std::exp(-0.5 * z * z / (k * k));
        const ContaminatedDensity at = contaminated_density(p, k, z);
        const double expected = std::log(body + wide), outlier = wide / (body + wide);
        EXPECT_NEAR(at.log_density, expected, 1e-14 * (1.0 + std::abs(expected)))
            << k << ' ' << p << ' ' << z;
        EXPECT_NEAR(at.outlier, outlier, 1e-14) << k << ' ' << p << ' ' << z;
        EXPECT_NEAR(at.weight, 1.0 - outlier + outlier / (k * k), 1e-14) << k << ' ' << p << ' ' << z;
        EXPECT_NEAR(log_density({NoiseShape::contaminated, 4.0, p, k}, z).value,
                    expected - 0.5 * std::log(2.0 * std::numbers::pi), 1e-14 * (2.0 + std::abs(expected)));
      }
}

TEST(ContaminatedDensity, OfGrossOutliersIsTheWideLaws) {
  // The plain formula is 0 / 0 from z = 39 k on. There nothing is left of the body: log(p / k) - z^2 / (2 k^2), 1 / k^2.
  for (const double k : {1.5, 3.0, 6.0})
    for (const double z : {-1000.0, 60.0, 300.0, 1000.0}) {
      const ContaminatedDensity at = contaminated_density(0.03, k, z);
      const double expected = std::log(0.03 / k) - 0.5 * z * z / (k * k);
      EXPECT_NEAR(at.log_density, expected, 1e-14 * std::abs(expected)) << k << ' ' << z;
      EXPECT_EQ(at.outlier, 1.0) << k << ' ' << z;
      EXPECT_NEAR(at.weight, 1.0 / (k * k), 1e-15) << k << ' ' << z;
    }
}

TEST(ShapeDensity, OfEchoesIsOneOfItsTermsFarOut) {
  // Far above, the echo alone; far below, the body and the echo's phi(z) / (1 - lambda z), lambda = 2 (see below).
  const NoiseShapeParameters late{NoiseShape::one_sided, 4.0, 0.1, 10.0, 2.0};
  for (const double z : {60.0, 500.0}) {
    const LogDensity at = log_density(late, z);
    const double expected = std::log(0.1) + one_sided_density(2.0, z).log_density;
    EXPECT_NEAR(at.value, expected, 1e-14 * std::abs(expected)) << z;
    EXPECT_EQ(at.outlier, 1.0) << z;
  }
  const double z = -100.0, body = std::log(0.9) - 0.5 * std::log(2.0 * std::numbers::pi) - 0.5 * z * z;
  const LogDensity below = log_density(late, z);
  EXPECT_NEAR(below.value, body + 0.1 / 0.9 / (1.0 - 2.0 * z), 1e-6);
  EXPECT_NEAR(below.outlier, 0.1 / 0.9 / (1.0 - 2.0 * z), 1e-6);
}

TEST(OneSidedDensity, IsThePlainFormulaWhereThatHasNumbers) {
  // lambda = 2, z = 1: x = 1/2, log h = -log 2 + 1/8 - 1/2 + log Phi(1/2), Phi(1/2) = 0.6914624612740131.
  const OneSidedDensity at = one_sided_density(2.0, 1.0);
  EXPECT_NEAR(at.log_density, -std::numbers::ln2 + 0.125 - 0.5 + std::log(0.6914624612740131), 1e-14);
  // M = phi(1/2) / Phi(1/2) = 0.3520653267642995 / 0.6914624612740131 = 0.509160438...; mean 1/2 + M, variance 1 - M mean.
  const double M = 0.3520653267642995 / 0.6914624612740131;
  EXPECT_NEAR(at.mean, 0.5 + M, 1e-14);
  EXPECT_NEAR(at.variance, 1.0 - M * (0.5 + M), 1e-14);
  // Far below, where Phi underflows: z^2 / 2 is nearly all of it, h(z) -> phi(z) / (1 - lambda z) for z -> -infinity.
  for (const double z : {-30.0, -200.0}) {
    const double rough = -0.5 * z * z - 0.5 * std::log(2.0 * std::numbers::pi) - std::log(1.0 - 2.0 * z);
    EXPECT_NEAR(one_sided_density(2.0, z).log_density, rough, 2e-3);
  }
  // Far above it is the exponential: slope -1 / lambda.
  EXPECT_NEAR(one_sided_density(2.0, 90.0).log_density - one_sided_density(2.0, 80.0).log_density, -5.0,
              1e-12);
}

TEST(NoiseShape, OneSidedDerivativesAgreeWithDifferences) {
  // Central differences of step h: errors of h^2 times a third derivative of order 1.
  constexpr double h = 1e-5;
  for (const double mean : {0.3, -0.15})
    for (const double z : {-9.0, -2.0, -0.3, 0.7, 4.0, 25.0}) {
      const double s = 0.04;
      NoiseShapeParameters shape{NoiseShape::one_sided, 4.0, 0.12, 10.0, mean};
      const LogDensity at = log_density(shape, z, s);
      const auto slope = [&](const auto& value) { return (value(h) - value(-h)) / (2.0 * h); };
      EXPECT_NEAR(at.derivative, slope([&](double e) { return log_density(shape, z + e, s).value; }), 1e-7);
      EXPECT_NEAR(at.derivative, at.shift - z, 1e-12);
      EXPECT_NEAR(at.in_log_s, slope([&](double e) { return log_density(shape, z, s * std::exp(e)).value; }),
                  1e-7);
      const auto moved = [&](double NoiseShapeParameters::*member, double by) {
        NoiseShapeParameters other = shape;
        other.*member += by;
        return log_density(other, z, s).value;
      };
      EXPECT_NEAR(at.in_shape[0],
                  slope([&](double e) { return moved(&NoiseShapeParameters::outlier_share, e); }), 1e-5);
      EXPECT_NEAR(at.in_shape[1],
                  slope([&](double e) { return moved(&NoiseShapeParameters::outlier_mean, e); }), 1e-5);
      EXPECT_GE(at.outlier, 0.0);
      EXPECT_LE(at.outlier, 1.0);
    }
}

TEST(NoiseShape, OneSidedIntegratesToOneWithItsStatedDeviation) {
  const NoiseShapeParameters shape{NoiseShape::one_sided, 4.0, 0.12, 10.0, 0.3};
  const double s = 0.05;
  double mass = 0.0, first = 0.0, second = 0.0;
  for (double z = -12.0; z < 400.0; z += 0.01) {  // mean 6 of the echoes: e^-60 is left
    const double p = 0.01 * std::exp(log_density(shape, z, s).value);
    mass += p;
    first += p * z;
    second += p * z * z;
  }
  EXPECT_NEAR(mass, 1.0, 1e-9);
  EXPECT_NEAR(first, 0.12 * 6.0, 1e-8);  // p times the mean of an echo
  EXPECT_NEAR(std::sqrt(second - first * first), standard_deviation(shape, s), 1e-8);
}

TEST(ShapeInformation, OfOneSidedOutliersThatAreToldForCertain) {
  // Echoes of 1e5 spreads say nothing of the mean: 1 - p, but for one in 1e4 of them near the body.
  const ShapeInformation far = shape_information({NoiseShape::one_sided, 4.0, 0.1, 10.0, 1e5}, 1.0);
  EXPECT_NEAR(far.location, 0.9, 1e-3);
  EXPECT_NEAR(far.spread(0, 0), 2.0 * 0.9, 2e-3);
  EXPECT_NEAR(far.weight, 1.0, 1e-9);
}

TEST(ShapeInformation, OfTheGaussian) {
  const ShapeInformation gaussian = shape_information({});
  EXPECT_NEAR(gaussian.location, 1.0, 1e-12);
  ASSERT_EQ(gaussian.spread.rows(), 1);
  EXPECT_NEAR(gaussian.spread(0, 0), 2.0, 1e-12);
}

TEST(ShapeInformation, OfStudentsTInClosedForm) {
  // Lange, Little, Taylor 1989, appendix B: location (nu + 1) / (nu + 3), log s 2 nu / (nu + 3), log s with nu
  // -2 / ((nu + 1) (nu + 3)), nu (trigamma(nu/2) - trigamma((nu+1)/2) - 2 (nu + 5) / (nu (nu + 1) (nu + 3))) / 4.
  // nu = 4: trigamma(2) = pi^2/6 - 1, trigamma(5/2) = pi^2/2 - 4 - 4/9, 2 * 9 / (4 * 5 * 7) = 9/70.
  const ShapeInformation four = shape_information(student_t(4.0));
  EXPECT_NEAR(four.location, 5.0 / 7.0, 1e-10);
  EXPECT_NEAR(four.spread(0, 0), 8.0 / 7.0, 1e-10);
  EXPECT_NEAR(four.spread(0, 1), -2.0 / 35.0, 1e-10);
  const double pi_sq = std::numbers::pi * std::numbers::pi;
  EXPECT_NEAR(four.spread(1, 1), 0.25 * (31.0 / 9.0 - pi_sq / 3.0 - 9.0 / 70.0), 1e-10);
  // The heaviest tails that may be, and nearly the Gaussian's.
  EXPECT_NEAR(shape_information(student_t(1.0)).location, 0.5, 1e-9);
  EXPECT_NEAR(shape_information(student_t(1.0)).spread(0, 0), 0.5, 1e-9);
  EXPECT_NEAR(shape_information(student_t(200.0)).spread(0, 0), 400.0 / 203.0, 1e-10);
}

TEST(ShapeInformation, OfAContaminatedNormalLiesBetweenItsParts) {
  // Outliers that are told for certain say 1 / k^2 of the mean each: 0.9 + 0.1 / 900; overlap takes a little of it.
  const ShapeInformation far = shape_information({NoiseShape::contaminated, 4.0, 0.1, 30.0});
  EXPECT_LT(far.location, 0.9 + 0.1 / 900.0);
  EXPECT_GT(far.location, 0.8);
  ASSERT_EQ(far.spread.rows(), 3);
  // The share alone: 1 / (p (1 - p)) = 11.1 of a coin whose sides are always seen.
  EXPECT_LT(far.spread(1, 1), 1.0 / 0.09);
  EXPECT_GT(far.spread(1, 1), 0.8 / 0.09);
  // Without outliers it is the Gaussian.
  EXPECT_NEAR(shape_information({NoiseShape::contaminated, 4.0, 1e-9, 10.0}).location, 1.0, 1e-6);
  EXPECT_THROW(shape_information({NoiseShape::automatic, 4.0, 0.1, 10.0}), InputError);
}

TEST(ShapeInformation, WeightsOfHeavyTailsAverageToOneOnlyForStudentsT) {
  EXPECT_NEAR(shape_information({}).weight, 1.0, 1e-12);
  EXPECT_NEAR(shape_information(student_t(4.0)).weight, 1.0, 1e-9);
  EXPECT_NEAR(shape_information(student_t(1.0)).weight, 1.0, 1e-9);
  // A reading of the core weighs 1, an outlier 1 / k^2, each by its probability: 1 - p + p / k^2.
  EXPECT_NEAR(shape_information({NoiseShape::contaminated, 4.0, 0.1, 10.0}).weight, 0.901, 1e-9);
  EXPECT_NEAR(shape_information({NoiseShape::contaminated, 4.0, 0.3, 5.0}).weight, 0.712, 1e-9);
  // By quadrature: w^2 z^2 averages to these.
  EXPECT_NEAR(shape_information({NoiseShape::contaminated, 4.0, 0.1, 10.0}).location, 0.82744, 1e-4);
  EXPECT_NEAR(shape_information({NoiseShape::contaminated, 4.0, 0.3, 5.0}).location, 0.52344, 1e-4);
}

TEST(ShapeInformation, LimitsAreWhereNothingIsKnown) {
  EXPECT_FALSE(at_limit({}));
  EXPECT_FALSE(at_limit(student_t(4.0)));
  EXPECT_TRUE(at_limit(student_t(1.0)));
  EXPECT_TRUE(at_limit(student_t(199.0)));
  EXPECT_FALSE(at_limit({NoiseShape::contaminated, 4.0, 0.05, 10.0}));
  EXPECT_TRUE(at_limit({NoiseShape::contaminated, 4.0, 1e-6, 10.0}));
  EXPECT_FALSE(at_limit({NoiseShape::contaminated, 4.0, 0.05, 30.0}));
  EXPECT_TRUE(at_limit({NoiseShape::contaminated, 4.0, 0.05, 1000.0}));
}

}  // namespace
}  // namespace rangecal
