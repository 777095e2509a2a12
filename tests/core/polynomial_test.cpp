// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/polynomial.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <limits>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

Eigen::VectorXd coefficients(std::initializer_list<double> values) {
  Eigen::VectorXd result(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), result.begin());
  return result;
}

// The coefficients of product (x - r).
Eigen::VectorXd from_roots(const std::vector<double>& roots) {
  Eigen::VectorXd p = Eigen::VectorXd::Ones(1);
  for (const double root : roots) {
    Eigen::VectorXd next = Eigen::VectorXd::Zero(p.size() + 1);
    next.tail(p.size()) += p;
    next.head(p.size()) -= root * p;
    p = next;
  }
  return p;
}

TEST(Polynomial, HandWorkedValueAndDerivative) {
  // f(2) = 0.0525 + 0.8838 * 2 + 0.0584 * 4 = 2.0537; f'(2) = 0.8838 + 2 * 0.0584 * 2 = 1.1174
  const Eigen::VectorXd alpha = coefficients({0.0525, 0.8838, 0.0584});
  EXPECT_NEAR(evaluate_polynomial(alpha, 2.0), 2.0537, 1e-15);
  EXPECT_NEAR(evaluate_derivative(alpha, 2.0), 1.1174, 1e-15);
  // (1, 2) [4 1; 1 9] (1, 2)^T = 4 + 2 * 2 + 9 * 4 = 44
  EXPECT_NEAR(evaluate_form(Eigen::Matrix2d{{4.0, 1.0}, {1.0, 9.0}}, 2.0), 44.0, 1e-12);
  EXPECT_EQ(evaluate_derivative(coefficients({3.0}), 2.0), 0.0);
}

TEST(Polynomial, RowOfPowers) {
  for (const double d : {0.0, -2.0}) {
    EXPECT_EQ(powers_of(d, 0).size(), 0);
    EXPECT_EQ(powers_of(d, 1), coefficients({1.0}));
  }
  EXPECT_EQ(powers_of(0.0, 4), coefficients({1.0, 0.0, 0.0, 0.0}));
  EXPECT_EQ(powers_of(-2.0, 4), coefficients({1.0, -2.0, 4.0, -8.0}));
}

TEST(Polynomial, RootsByClosedForm) {
  EXPECT_THAT(real_roots(coefficients({-3.0, 2.0}), -10, 10), ElementsAre(1.5));
  EXPECT_THAT(real_roots(coefficients({6.0, -5.0, 1.0}), -10, 10), ElementsAre(2.0, 3.0));
  EXPECT_THAT(real_roots(coefficients({6.0, -5.0, 1.0}), 2.5, 10), ElementsAre(3.0));
  EXPECT_THAT(real_roots(coefficients({1.0, 0.0, 1.0}), -10, 10), IsEmpty());
  EXPECT_THAT(real_roots(coefficients({1.0, -2.0, 1.0}), -10, 10), ElementsAre(1.0));
  // x^2 - 1e8 x + 1: the small root cancels in the school formula. r = 1e-8 (1 + 1e-16 + ...)
  EXPECT_THAT(real_roots(coefficients({1.0, -1e8, 1.0}), 0, 1), ElementsAre(DoubleNear(1e-8, 1e-23)));
}

TEST(Polynomial, DegenerateOnesHaveNoRoots) {
  EXPECT_THAT(real_roots(coefficients({}), -1, 1), IsEmpty());
  EXPECT_THAT(real_roots(coefficients({0.0, 0.0}), -1, 1), IsEmpty());
  EXPECT_THAT(real_roots(coefficients({2.0}), -1, 1), IsEmpty());
  EXPECT_THAT(real_roots(coefficients({1.0, std::numeric_limits<double>::quiet_NaN()}), -1, 1), IsEmpty());
  EXPECT_THAT(real_roots(coefficients({-1.0, 1.0, 0.0, 0.0}), -2, 2), ElementsAre(1.0));
}

TEST(Polynomial, RootsOfHigherDegree) {
  // Simple roots a tenth apart or more: conditioning costs a few digits at most.
  EXPECT_THAT(real_roots(from_roots({-1.0, 0.3, 2.0}), -5, 5),
              ElementsAre(DoubleNear(-1.0, 1e-12), DoubleNear(0.3, 1e-12), DoubleNear(2.0, 1e-12)));
  // (x^2 + 1)(x - 2)(x - 4) = x^4 - 6 x^3 + 9 x^2 - 6 x + 8
  EXPECT_THAT(real_roots(coefficients({8.0, -6.0, 9.0, -6.0, 1.0}), -9, 9),
              ElementsAre(DoubleNear(2.0, 1e-12), DoubleNear(4.0, 1e-12)));
  // A double root comes once, to about the square root of machine precision.
  EXPECT_THAT(real_roots(from_roots({1.0, 1.0, 3.0}), -9, 9),
              ElementsAre(DoubleNear(1.0, 1e-6), DoubleNear(3.0, 1e-12)));
  // x^3 = 0 has the root 0, three times.
  EXPECT_THAT(real_roots(coefficients({0.0, 0.0, 0.0, 1.0}), -1, 1), ElementsAre(DoubleNear(0.0, 1e-5)));
}

TEST(Polynomial, RandomRootsAreFound) {
  for (std::uint64_t seed = 0; seed < 300; ++seed) {
    Random random(seed_from("Polynomial.RandomRootsAreFound", {seed}));
    std::vector<double> roots;
    double root = random.uniform(-2.0, 0.0);
    for (std::uint64_t i = 0, n = 3 + random.index(3); i < n; ++i) {
      roots.push_back(root);
      root += random.uniform(0.2, 2.0);
    }
    const double scale = random.uniform(0.01, 100.0);
    const std::vector<double> found = real_roots(scale * from_roots(roots), -20, 20);
    ASSERT_EQ(found.size(), roots.size()) << "seed " << seed;
    // Roots at least 0.2 apart, up to degree 5 and 12 in size: the condition number stays below 1e6.
    for (std::size_t i = 0; i < roots.size(); ++i) EXPECT_NEAR(found[i], roots[i], 1e-9) << "seed " << seed;
  }
}

TEST(InvertNear, HandWorkedAndThereAndBack) {
  const Eigen::VectorXd alpha = coefficients({0.0525, 0.8838, 0.0584});
  EXPECT_NEAR(invert_near(alpha, 2.0537).value_or(0.0), 2.0, 1e-14);  // f(2), see above
  for (double d = 0.01; d < 50.0; d *= 1.1)
    EXPECT_NEAR(invert_near(alpha, evaluate_polynomial(alpha, d)).value_or(0.0) / d, 1.0, 1e-13) << d;
  // f = 1 + 0.04 d is flatter than 0.05 and is inverted where that is allowed: (2 - 1) / 0.04 = 25
  EXPECT_NEAR(invert_near(coefficients({1.0, 0.04}), 2.0, 0.01).value_or(0.0), 25.0, 1e-12);
}

TEST(InvertNear, SettlesToTheRoundingOfACurveThatCancels) {
  // f = d + 0.05 prod_{k=1..8} (d - k / 2): at 4 m terms of 1e5 m in all leave f known to 1e-11 m.
  Eigen::VectorXd wild = 0.05 * from_roots({0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0});
  wild[1] += 1.0;
  for (const double d : {2.0, 2.4, 3.5, 3.8, 3.9, 4.0, 4.1})
    EXPECT_NEAR(invert_near(wild, evaluate_polynomial(wild, d)).value_or(0.0), d, 1e-9) << d;
}

TEST(InvertNear, SaysWhereThereIsNone) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const Eigen::VectorXd alpha = coefficients({0.0525, 0.8838, 0.0584});
  for (const double reading : {std::numeric_limits<double>::quiet_NaN(), infinity, 1e308, -1.0, 0.0})
    EXPECT_FALSE(invert_near(alpha, reading)) << reading;
  EXPECT_FALSE(invert_near(coefficients({1.0, 0.04}), 2.0));  // too flat
  EXPECT_FALSE(invert_near(coefficients({5.0, -1.0}), 2.0));  // falls
  EXPECT_FALSE(invert_near(coefficients({3.0, 1.0}), 2.0));   // d = -1
  EXPECT_FALSE(invert_near(coefficients({3.0, 1.0}), 3.0));   // d = 0
  EXPECT_FALSE(invert_near(coefficients({}), 2.0));
  EXPECT_FALSE(invert_near(coefficients({0.0, std::numeric_limits<double>::quiet_NaN()}), 2.0));
}

TEST(InvertNear, ReturnsNoStepThatIsStillUnderWay) {
  // f = 3 + g(d - 2), 23 g(x) = 23 x - 10 x^3 + 3 x^5, rises everywhere. g(1) = 16/23, g'(1) = 8/23: from d = 3 Newton's
  // step is 2, from d = 1 it is -2, and so for ever (g''(1) = 0, so that rounding does not end it).
  const Eigen::VectorXd cycle = coefficients({7.0, 143.0, -180.0, 110.0, -30.0, 3.0}) / 23.0;
  ASSERT_NEAR(evaluate_polynomial(cycle, 2.0), 3.0, 1e-14);
  EXPECT_FALSE(invert_near(cycle, 3.0));
}

}  // namespace
}  // namespace rangecal
