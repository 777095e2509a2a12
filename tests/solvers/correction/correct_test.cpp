// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/correct.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"
#include "support/calibration_of.hpp"

namespace rangecal {
namespace {

using testing::calibration_of;

const Eigen::VectorXd paper_alpha{{0.0525, 0.8838, 0.0584}};

/// argmin of the NLL of y within `reach` of `near`, by golden section: independent of the code under test.
double golden_minimum(const Calibration& c, double y, double near, double reach) {
  const auto nll = [&](double d) {
    const double f = evaluate_polynomial(c.alpha, d), s = c.noise.spread(d, f);
    return std::log(s) + (y - f) * (y - f) / (2 * s * s);
  };
  double a = near - reach, b = near + reach;
  const double ratio = 0.5 * (std::sqrt(5.0) - 1.0);
  for (int step = 0; step < 120; ++step) {
    const double x1 = b - ratio * (b - a), x2 = a + ratio * (b - a);
    (nll(x1) < nll(x2) ? b : a) = nll(x1) < nll(x2) ? x2 : x1;
  }
  return 0.5 * (a + b);
}

TEST(Correct, LeastSquaresRoundTrip) {
  const Eigen::VectorXd cubic{{0.05, 0.9, 0.02, 0.003}}, quintic{{0.02, 0.95, 0.01, -0.002, 0.001, 0.0001}};
  for (const Eigen::VectorXd& alpha : {Eigen::VectorXd(paper_alpha.head(2)), paper_alpha, cubic, quintic}) {
    const Calibration c = calibration_of(alpha, NoiseLaw::f_squared, 0.01);
    for (double d = 0.3; d <= 5.0; d += 0.094) {
      const Correction correction = correct(c, evaluate_polynomial(alpha, d));
      ASSERT_EQ(correction.outcome, Outcome::converged);
      ASSERT_EQ(correction.least_squares.size(), 1u) << d;
      EXPECT_NEAR(correction.least_squares[0].distance_m, d, 1e-10);
    }
  }
}

TEST(Correct, TheLeastSquaresDistanceIsThatOfTheWholeAnswer) {
  // One root, three of which one is the likeliest, and beyond either end, where the nearest counts.
  const Eigen::VectorXd bent{{0.3, 2.4, -1.5, 0.26}};
  Random random(seed_from("least-squares distance"));
  int several = 0, none = 0;
  for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::d_squared})
    for (const Eigen::VectorXd& alpha : {paper_alpha, bent})
      for (int i = 0; i < 200; ++i) {
        const Calibration c = calibration_of(alpha, law, 0.01);
        const double y = random.uniform(0.01, 9.0);
        const Correction whole = correct(c, y);
        const double expected = whole.best_least_squares >= 0
                                    ? whole.least_squares[whole.best_least_squares].distance_m
                                    : whole.nearest->distance_m;
        several += whole.least_squares.size() > 1;
        none += whole.least_squares.empty();
        EXPECT_EQ(least_squares_distance(c, y), expected) << to_string(law) << ' ' << y;
      }
  EXPECT_GT(several, 20);
  EXPECT_GT(none, 20);
}

TEST(Correct, MaximumLikelihoodHandWorked) {
  // f(d) = d, s = sigma f^2, sigma^2 = 0.1, y = 1: (1 - f)(2 - f) = 0.2 f^4.
  // f = 0.888: 0.112*1.112 = 0.124544 against 0.2*0.621801 = 0.124360; f = 0.889: 0.111*1.111 = 0.123321
  // against 0.2*0.624607 = 0.124921. Root at 0.888 + 0.001*0.000184/(0.000184 + 0.001600) = 0.88810.
  const Calibration c = calibration_of(Eigen::VectorXd{{0.0, 1.0}}, NoiseLaw::f_squared, std::sqrt(0.1));
  const Correction correction = correct(c, 1.0);
  ASSERT_FALSE(correction.maximum_likelihood.empty());
  const double d = correction.maximum_likelihood[correction.best_maximum_likelihood].distance_m;
  EXPECT_NEAR((1 - d) * (2 - d), 0.2 * std::pow(d, 4), 1e-12);
  EXPECT_NEAR(d, 0.88810, 1e-5);
}

TEST(Correct, MaximumLikelihoodIsTheMinimumForEveryLaw) {
  for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed,
                             NoiseLaw::d_squared, NoiseLaw::polynomial}) {
    Calibration c = calibration_of(paper_alpha, law, 0.02);
    if (law == NoiseLaw::polynomial) c.noise.parameters = 0.05 * paper_alpha;
    for (const double d : {0.5, 1.7, 3.1, 4.2}) {
      const double y = evaluate_polynomial(paper_alpha, d);
      const Correction correction = correct(c, y);
      ASSERT_GE(correction.best_maximum_likelihood, 0) << to_string(law);
      const double ml = correction.maximum_likelihood[correction.best_maximum_likelihood].distance_m;
      // a golden section finds a flat minimum to the square root of rounding
      EXPECT_NEAR(ml, golden_minimum(c, y, d, 0.25 * d), 1e-6) << to_string(law) << " at " << d;
      if (law == NoiseLaw::constant) {
        EXPECT_NEAR(ml, d, 1e-10);
      } else {
        EXPECT_LT(ml, d);
      }
    }
  }
}

TEST(Correct, QuarticOfTheDSquaredLaw) {
  // 2016 eq. 27: (y - f)(y - f + d f'/2) = sigma^2 d^4 holds at the root
  const double sigma = 0.03, y = 2.5;
  const Calibration c = calibration_of(paper_alpha, NoiseLaw::d_squared, sigma);
  const double d = correct(c, y).maximum_likelihood.at(0).distance_m;
  const double f = evaluate_polynomial(c.alpha, d), slope = evaluate_derivative(c.alpha, d);
  EXPECT_NEAR((y - f) * (y - f + 0.5 * d * slope), sigma * sigma * std::pow(d, 4), 1e-12);
}

TEST(Correct, ReportsBothRootsOfACurveThatTurns) {
  // f = 2 d - 0.25 d^2 turns at d = 4, f(4) = 4. f(d) = 3: d = (2 -+ sqrt(4 - 3)) / 0.5 = 2 and 6
  for (const NoiseLaw law : {NoiseLaw::f_squared, NoiseLaw::constant}) {
    const Calibration c = calibration_of(Eigen::VectorXd{{0.0, 2.0, -0.25}}, law, 0.001, 0.5, 7.0);
    const Correction correction = correct(c, 3.0);
    ASSERT_EQ(correction.least_squares.size(), 2u);
    EXPECT_NEAR(correction.least_squares[0].distance_m, 2.0, 1e-12);
    EXPECT_NEAR(correction.least_squares[1].distance_m, 6.0, 1e-12);
    ASSERT_EQ(correction.maximum_likelihood.size(), 2u);
    EXPECT_NEAR(correction.maximum_likelihood[0].distance_m, 2.0, 1e-4);
    EXPECT_NEAR(correction.maximum_likelihood[1].distance_m, 6.0, 1e-4);
  }
}

TEST(Correct, ReadingBeyondTheCurveGetsTheNearestPointWithAFlag) {
  const Calibration turning =
      calibration_of(Eigen::VectorXd{{0.0, 2.0, -0.25}}, NoiseLaw::constant, 0.1, 0.5, 7.0);
  const Correction beyond = correct(turning, 4.2);
  EXPECT_TRUE(beyond.least_squares.empty());
  EXPECT_EQ(beyond.best_least_squares, -1);
  ASSERT_TRUE(beyond.nearest);
  EXPECT_NEAR(beyond.nearest->distance_m, 4.0, 1e-9);
  EXPECT_TRUE(beyond.nearest->turning_point);
  EXPECT_FALSE(beyond.nearest->std_dev_m);
  ASSERT_EQ(beyond.maximum_likelihood.size(), 1u);
  EXPECT_TRUE(beyond.maximum_likelihood[0].turning_point);

  const Calibration line = calibration_of(Eigen::VectorXd{{0.0, 1.0}}, NoiseLaw::f_squared, 0.01, 0.3, 5.0);
  const Correction far = correct(line, 9.0);
  EXPECT_EQ(far.outcome, Outcome::failed);
  ASSERT_TRUE(far.nearest);
  EXPECT_NEAR(far.nearest->distance_m, 5.47, 1e-9);  // 5 + 0.1 (5 - 0.3)
  EXPECT_TRUE(far.nearest->extrapolated);
  EXPECT_FALSE(far.reason.empty());
}

TEST(Correct, StandardDeviationsHandWorked) {
  // f = 0.1 + 2 d, s = 0.01 f^2; y = 2.1: d = 1, s = 0.0441, s/f' = 0.02205.
  // cov(alpha) = diag(1e-4, 4e-4): phi^T C phi = 5e-4; total = sqrt(0.0441^2 + 5e-4)/2
  Calibration c = calibration_of(Eigen::VectorXd{{0.1, 2.0}}, NoiseLaw::f_squared, 0.01);
  EXPECT_FALSE(correct(c, 2.1).least_squares.at(0).std_dev_total_m);
  c.alpha_covariance = Eigen::Vector2d(1e-4, 4e-4).asDiagonal();
  const CorrectionRoot root = correct(c, 2.1).least_squares.at(0);
  EXPECT_NEAR(*root.std_dev_m, 0.02205, 1e-12);
  EXPECT_NEAR(*root.std_dev_total_m, 0.5 * std::sqrt(0.0441 * 0.0441 + 5e-4), 1e-12);
  EXPECT_NEAR(root.log_likelihood, -std::log(0.0441) - 0.5 * std::log(2 * M_PI), 1e-12);
  // With the choice of order in it, padded to order 2: diag(1e-4, 4e-4, 9e-4) gives 14e-4.
  c.covariance_with_choice = Eigen::Vector3d(1e-4, 4e-4, 9e-4).asDiagonal();
  const double chosen = 0.5 * std::sqrt(0.0441 * 0.0441 + 14e-4);
  EXPECT_NEAR(*correct(c, 2.1).least_squares.at(0).std_dev_total_m, chosen, 1e-12);
  c.effects["range_offset"]["offset_m"] = 0.0;
  EXPECT_NEAR(*EffectCorrector(c, {}).correct(2.1, {}).least_squares.at(0).std_dev_total_m, chosen, 1e-12);
}

TEST(Correct, StandardDeviationPredictsTheScatter) {
  const Calibration c = calibration_of(paper_alpha, NoiseLaw::f_squared, 0.01);
  Random random(seed_from("Correct.Scatter"));
  double square = 0.0;
  for (int k = 0; k < 2000; ++k) {
    const double f = evaluate_polynomial(paper_alpha, 2.0);
    const CorrectionRoot root = correct(c, f + 0.01 * f * f * random.normal()).least_squares.at(0);
    square += std::pow((root.distance_m - 2.0) / *root.std_dev_m, 2) / 2000.0;
  }
  EXPECT_NEAR(square, 1.0, 0.13);  // four of sqrt(2 / 2000)
}

TEST(Correct, WrongInputIsNamed) {
  const Calibration c = calibration_of(paper_alpha, NoiseLaw::f_squared, 0.01);
  EXPECT_THROW(correct(c, -1.0), InputError);
  EXPECT_THROW(correct(c, std::nan("")), InputError);
  EXPECT_THROW(correct(calibration_of(Eigen::VectorXd(), NoiseLaw::f, 0.01), 1.0), InputError);
  EXPECT_THROW(correct(calibration_of(paper_alpha, NoiseLaw::f, 0.01, 2.0, 1.0), 1.0), InputError);
}

}  // namespace
}  // namespace rangecal
