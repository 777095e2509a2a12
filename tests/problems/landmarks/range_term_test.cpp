// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/range_term.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/landmarks/power_law_term.hpp"

namespace rangecal {
namespace {

TEST(Taylor, HandWorkedSeries) {
  // 1 / (2 + h) = 1/2 - h/4 + h^2/8 - h^3/16, log(2 + h) = log 2 + h/2 - h^2/8 + h^3/24,
  // (2 + h) (3 - h + h^2 + 5 h^3) = 6 + h + h^2 + 11 h^3 + ...
  const Taylor<3> a{{2.0, 1.0, 0.0, 0.0}}, b{{3.0, -1.0, 1.0, 5.0}};
  const Taylor<3> inverse = reciprocal(a), logarithm = log(a, inverse), product = a * b;
  const double inverses[] = {0.5, -0.25, 0.125, -0.0625},
               logarithms[] = {std::log(2.0), 0.5, -0.125, 1.0 / 24.0};
  const double products[] = {6.0, 1.0, 1.0, 11.0}, differences[] = {-1.0, 2.0, -1.0, -5.0};
  for (int k = 0; k <= 3; ++k) {
    EXPECT_DOUBLE_EQ(inverse.c[k], inverses[k]);
    EXPECT_DOUBLE_EQ(logarithm.c[k], logarithms[k]);
    EXPECT_DOUBLE_EQ(product.c[k], products[k]);
    EXPECT_DOUBLE_EQ((a - b).c[k], differences[k]);
    EXPECT_DOUBLE_EQ((2.0 * b).c[k] - (b + b).c[k], 0.0);
  }
  EXPECT_EQ(b.first(), -1.0);
  EXPECT_EQ(b.second(), 2.0);  // 2! 1
  EXPECT_EQ(b.third(), 30.0);  // 3! 5
}

/// d fn / dx at 0 by differences whose own error is of order h^4.
double slope(const std::function<double(double)>& fn, double h = 1e-3) {
  return (8.0 * (fn(h) - fn(-h)) - (fn(2.0 * h) - fn(-2.0 * h))) / (12.0 * h);
}
// h^4 of the fifth derivative and rounding of 1e-16 / h, both relative to sums of terms of size 1e3.
void expect_slope(double derivative, const std::function<double(double)>& fn) {
  const double numeric = slope(fn);
  EXPECT_NEAR(derivative, numeric, 1e-7 * (1.0 + std::abs(numeric)));
}

class RangeTermTest : public ::testing::TestWithParam<NoiseLaw> {
 protected:
  RangeTermTest() {
    cells.count = {7.0, 5.0};
    cells.range_weight = {7.0, 4.5};
    cells.range_mean = {9.0, 1.75};
    cells.range_mean_square = {9.0, 0.03};
    cells.effect_slope = {9.0, 0.2};
    cells.effect_slope_at_m = {9.0, 1.1};
    noise.law = GetParam();
    noise.parameters = GetParam() == NoiseLaw::polynomial ? Eigen::VectorXd(Eigen::Vector3d(0.1, 0.15, 0.02))
                                                          : Eigen::VectorXd::Constant(1, 0.3);
  }
  /// The noise with its coordinate j moved: the logarithm of sigma, or beta_j.
  Noise moved(int j, double h) const {
    Noise other = noise;
    other.parameters[j] =
        GetParam() == NoiseLaw::polynomial ? noise.parameters[j] + h : noise.parameters[j] * std::exp(h);
    return other;
  }
  RangeTerm<3> at(double distance, const Eigen::VectorXd& a, const Noise& n) const {
    RangeTerm<3> term;
    EXPECT_TRUE(term.evaluate(distance, cells, 1, a, n));
    return term;
  }
  RangeTerm<3> in_alpha(int i, double h) const { return at(d, alpha + h * Eigen::Vector3d::Unit(i), noise); }
  RangeTerm<3> in_tau(int j, double h) const { return at(d, alpha, moved(j, h)); }
  RangeTerm<3> in_d(double h) const { return at(d + h, alpha, noise); }

  const double d = 1.6;
  const Eigen::Vector3d alpha{0.1, 0.9, 0.07};
  Cells cells;
  Noise noise;
};

TEST_P(RangeTermTest, CostIsTheEquation) {
  // f(1.6) = 0.1 + 1.44 + 0.1792 = 1.7192, b (d - d_0) = 0.2 0.5 = 0.1: e = 1.75 - 1.7192 - 0.1 = -0.0692.
  const double s = noise.spread(d, 1.7192), chi_sq = 4.5 * (0.0692 * 0.0692 + 0.03) / (s * s);
  EXPECT_NEAR(at(d, alpha, noise).cost.value(), 5.0 * std::log(s) + 0.5 * chi_sq, 1e-12);
}

TEST_P(RangeTermTest, DerivativesMatchDifferences) {
  const RangeTerm<3> term = at(d, alpha, noise);
  expect_slope(term.cost.first(), [&](double h) { return in_d(h).cost.value(); });
  expect_slope(term.cost.second(), [&](double h) { return in_d(h).cost.first(); });
  expect_slope(term.cost.third(), [&](double h) { return in_d(h).cost.second(); });
  const int taus = term.noise_parameters();
  ASSERT_EQ(term.coefficients(), 3);
  for (int i = 0; i < 3; ++i) {
    SCOPED_TRACE(i);
    expect_slope(term.by_alpha(i).value(), [&](double h) { return in_alpha(i, h).cost.value(); });
    expect_slope(term.by_alpha(i).first(), [&](double h) { return in_alpha(i, h).cost.first(); });
    expect_slope(term.by_alpha(i).second(), [&](double h) { return in_alpha(i, h).cost.second(); });
    expect_slope(term.by_alpha(i).third(), [&](double h) { return in_alpha(i, h).cost.third(); });
    for (int j = 0; j < 3; ++j)
      expect_slope(term.alpha_alpha * std::pow(d, i + j),
                   [&](double h) { return in_alpha(j, h).by_alpha(i).value(); });
    for (int j = 0; j < taus; ++j)
      expect_slope(term.alpha_tau * std::pow(d, i) * term.tau_slope(j),
                   [&](double h) { return in_tau(j, h).by_alpha(i).value(); });
  }
  for (int j = 0; j < taus; ++j) {
    SCOPED_TRACE(j);
    expect_slope(term.by_tau(j).value(), [&](double h) { return in_tau(j, h).cost.value(); });
    expect_slope(term.by_tau(j).first(), [&](double h) { return in_tau(j, h).cost.first(); });
    expect_slope(term.by_tau(j).second(), [&](double h) { return in_tau(j, h).cost.second(); });
    expect_slope(term.tau_slope(j), [&](double h) { return std::log(moved(j, h).spread(d, 1.7192)); });
    for (int k = 0; k < taus; ++k)
      expect_slope(term.tau_tau * term.tau_slope(j) * term.tau_slope(k),
                   [&](double h) { return in_tau(k, h).by_tau(j).value(); });
  }
}

TEST_P(RangeTermTest, FisherInformationIsThatOfANormalLaw) {
  // Of mean mu(x) and log spread lambda(x): W mu_x mu_y / s^2 + 2 R lambda_x lambda_y. mu_alpha_0 = 1, mu_tau
  // = 0, mu_d = f' + b = 0.9 + 2 0.07 1.6 + 0.2 = 1.324; lambda in log s itself: 1.
  const RangeTerm<3> term = at(d, alpha, noise);
  const auto f_at = [&](double x) { return 0.1 + 0.9 * x + 0.07 * x * x; };
  const double s = noise.spread(d, 1.7192), mean = 4.5 / (s * s);
  const double by_d = slope([&](double h) { return std::log(noise.spread(d + h, f_at(d + h))); });
  const double by_f = slope([&](double h) { return std::log(noise.spread(d, 1.7192 + h)); });
  const double rounding = 1e-9 * mean;  // of the differences
  EXPECT_NEAR(term.fisher_d_d, mean * 1.324 * 1.324 + 10.0 * by_d * by_d, rounding);
  EXPECT_NEAR(term.fisher_d_alpha, mean * 1.324 + 10.0 * by_d * by_f, rounding);
  EXPECT_NEAR(term.fisher_d_tau, 10.0 * by_d, rounding);
  EXPECT_NEAR(term.fisher_alpha_alpha, mean + 10.0 * by_f * by_f, rounding);
  EXPECT_NEAR(term.fisher_alpha_tau, 10.0 * by_f, rounding);
  EXPECT_EQ(term.fisher_tau_tau, 10.0);
}

TEST_P(RangeTermTest, RefusesWhatIsOutsideOfTheDomain) {
  RangeTerm<3> term;
  const Eigen::Vector3d negative(-10.0, 0.9, 0.07);
  Noise none = noise;
  none.parameters.setZero();
  EXPECT_FALSE(term.evaluate(0.0, cells, 1, alpha, noise));
  EXPECT_FALSE(term.evaluate(d, cells, 1, alpha, none));
  EXPECT_EQ(term.evaluate(d, cells, 1, negative, noise), noise.power_of_f() == 0);
}

INSTANTIATE_TEST_SUITE_P(Laws, RangeTermTest,
                         ::testing::Values(NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared,
                                           NoiseLaw::f_cubed, NoiseLaw::d_squared, NoiseLaw::polynomial));

TEST(PowerLawTerm, CostAndDerivativesOfEveryPower) {
  // R = 5, W = 4.5, y_bar = 1.75, S^2 = 0.03, sigma = 0.3 at f = 1.7: e = 0.05.
  const double f = 1.7, sigma = 0.3;
  for (int power = 0; power <= 3; ++power) {
    SCOPED_TRACE(power);
    const auto at = [&](double df, double dtau) {
      const double s = sigma * std::exp(dtau);
      return PowerLawTerm({power, 1.0 / (s * s)}, f + df, 5.0, 4.5, 1.75, 0.03);
    };
    const auto cost = [&](double df, double dtau) {
      const double s = sigma * std::exp(dtau) * std::pow(f + df, power), e = 1.75 - f - df;
      return 5.0 * std::log(s) + 4.5 * (e * e + 0.03) / (2.0 * s * s);
    };
    const PowerLawTerm term = at(0.0, 0.0);
    const double s = sigma * std::pow(f, power);
    EXPECT_NEAR(term.P, 4.5 / (s * s), 1e-12 * term.P);
    EXPECT_NEAR(term.e, 0.05, 1e-15);
    EXPECT_NEAR(term.chi_sq, 4.5 * 0.0325 / (s * s), 1e-12 * term.chi_sq);  // 0.05^2 + 0.03
    EXPECT_NEAR(term.inverse_f, power > 0 ? 1.0 / 1.7 : 0.0, 1e-15);
    expect_slope(term.by_f, [&](double h) { return cost(h, 0.0); });
    expect_slope(term.by_tau, [&](double h) { return cost(0.0, h); });
    expect_slope(term.by_f_f, [&](double h) { return at(h, 0.0).by_f; });
    expect_slope(term.by_f_tau, [&](double h) { return at(0.0, h).by_f; });
    expect_slope(term.by_tau_tau(), [&](double h) { return at(0.0, h).by_tau; });
    expect_slope(term.third(), [&](double h) { return at(h, 0.0).by_f_f; });
    expect_slope(term.by_f_f_tau(), [&](double h) { return at(0.0, h).by_f_f; });
    EXPECT_NEAR(term.fisher_f_f(5.0), term.P + 10.0 * power * power / (1.7 * 1.7), 1e-12 * (1.0 + term.P));
    EXPECT_NEAR(term.fisher_f_tau(5.0), 10.0 * power / 1.7, 1e-12);
  }
}

}  // namespace
}  // namespace rangecal
