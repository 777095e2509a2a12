// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/closed_form/pairs_approximate.hpp"
#include "rangecal/solvers/statistics/information_criteria.hpp"

namespace rangecal {
namespace {

struct Data {
  std::vector<double> d, y;
};

/// f of the 2021 simulations, with noise sigma_e f^2 (or d^2).
Data curve_data(int N, double sigma_e, std::uint64_t seed) {
  Random random(seed);
  Data data;
  for (int k = 0; k < N; ++k) {
    const double d = 0.3 + 4.7 * k / (N - 1.0), f = 0.0525 + 0.8838 * d + 0.0584 * d * d;
    data.d.push_back(d);
    data.y.push_back(f + (sigma_e > 0.0 ? sigma_e * f * f * random.normal() : 0.0));
  }
  return data;
}

TEST(PolynomialFit, ExactOnNoiseFreeDataUpToOrderFive) {
  const Eigen::VectorXd alpha{{0.05, 0.9, 0.03, -0.02, 0.004, -0.0003}};
  for (int order = 0; order <= 5; ++order) {
    std::vector<double> d, y;
    for (int k = 0; k <= 20; ++k) {
      d.push_back(0.2 + 0.25 * k);
      double value = 0.0;
      for (int i = order; i >= 0; --i) value = value * d.back() + alpha(i);
      y.push_back(value);
    }
    const PolynomialFit fit = fit_polynomial(d, y, order);
    ASSERT_TRUE(fit.usable());
    EXPECT_LT((fit.alpha - alpha.head(order + 1)).cwiseAbs().maxCoeff(), 1e-10) << order;
  }
}

TEST(PolynomialFit, OddPowersExact) {
  std::vector<double> d{0.5, 1.0, 2.0, 3.0, 4.0}, y;
  for (const double x : d) y.push_back(0.9 * x - 0.01 * x * x * x);
  const PolynomialFit fit = fit_polynomial(d, y, 1, {}, PolynomialBasis::odd_powers);
  EXPECT_NEAR(fit.alpha(0), 0.9, 1e-12);
  EXPECT_NEAR(fit.alpha(1), -0.01, 1e-12);
  EXPECT_NEAR(evaluate_in_basis(fit.alpha, 2.0, PolynomialBasis::odd_powers), 1.72, 1e-12);
}

TEST(PolynomialFit, WeightedAgreesWithR) {
  // R 4.2: x<-c(1.03,2.11,2.95,4.12,4.88,6.07); y<-c(1.2,2.3,3.1,4.6,5.1,6.9); w<-c(1,2,1,4,1,0.5)
  //        m<-lm(y~x+I(x^2),weights=w); coef(m); sum(w*resid(m)^2); AIC(m)
  const std::vector<double> d{1.03, 2.11, 2.95, 4.12, 4.88, 6.07}, y{1.2, 2.3, 3.1, 4.6, 5.1, 6.9},
      w{1, 2, 1, 4, 1, 0.5};
  const PolynomialFit fit = fit_polynomial(d, y, 2, w);
  EXPECT_NEAR(fit.alpha(0), 0.1442048883393481, 1e-10);
  EXPECT_NEAR(fit.alpha(1), 0.9889568597328664, 1e-10);
  EXPECT_NEAR(fit.alpha(2), 0.0174298834357326, 1e-10);
  EXPECT_NEAR(fit.rss, 0.130096879791022, 1e-10);
  EXPECT_NEAR(aic(fit.nll, 4.0), 0.653555960507, 1e-9);
}

TEST(PolynomialFit, CofactorHandWorked) {
  // d = -1, 0, 1: H^T H = diag(3, 2)
  const std::vector<double> d{-1, 0, 1}, y{0, 1, 1};
  const PolynomialFit fit = fit_polynomial(d, y, 1);
  EXPECT_NEAR(fit.cofactor(0, 0), 1.0 / 3.0, 1e-12);
  EXPECT_NEAR(fit.cofactor(1, 1), 0.5, 1e-12);
  EXPECT_NEAR(fit.cofactor(0, 1), 0.0, 1e-12);
  EXPECT_NEAR(fit.alpha(1), 0.5, 1e-12);
  EXPECT_NEAR(fit.rss, 1.0 / 6.0, 1e-12);  // residuals -1/6, 1/3, -1/6
}

TEST(PolynomialFit, DegenerateDataIsNamed) {
  const std::vector<double> same(6, 1.5), y{1, 2, 3, 4, 5, 6}, two{1, 2};
  EXPECT_EQ(fit_polynomial(same, y, 1).outcome, Outcome::too_few_data);
  EXPECT_EQ(fit_polynomial(same, y, 0).outcome, Outcome::converged);
  EXPECT_EQ(fit_polynomial(two, two, 2).outcome, Outcome::too_few_data);
  EXPECT_THROW(fit_polynomial(two, y, 1), InputError);
  EXPECT_THROW(fit_polynomial(two, two, -1), InputError);
  EXPECT_THROW(fit_polynomial(two, two, 1, std::vector<double>{1.0, 0.0}), InputError);
}

TEST(SelectOrder, FindsTheOrderOfNoiseFreeData) {
  const Data data = curve_data(60, 0.0, 1);
  for (const OrderCriterion criterion : {OrderCriterion::aic, OrderCriterion::aicc, OrderCriterion::bic}) {
    OrderOptions options;
    options.criterion = criterion;
    EXPECT_EQ(select_order(data.d, data.y, options).order, 2);
  }
}

TEST(SelectOrder, EveryCriterionFindsTheCurveInNoise) {
  // 2021: order 2 in noise of about 1 %. AIC overfits now and then by design, the others rarely
  for (const OrderCriterion criterion : {OrderCriterion::aic, OrderCriterion::aicc, OrderCriterion::bic,
                                         OrderCriterion::cross_validation, OrderCriterion::thirds}) {
    int right = 0, low = 0;
    for (std::uint64_t repeat = 0; repeat < 50; ++repeat) {
      const Data data = curve_data(300, 0.005, seed_from("SelectOrder", {repeat}));
      std::vector<double> weights;
      for (const double d : data.d) weights.push_back(std::pow(d, -4));
      OrderOptions options;
      options.criterion = criterion;
      options.max_order = 4;
      const OrderSelection selection = select_order(data.d, data.y, options, weights);
      EXPECT_EQ(selection.scores.size(), 5u);
      right += selection.order == 2;
      low += selection.order < 2;
      if (criterion == OrderCriterion::thirds) {
        EXPECT_GT(selection.test_mse, 0.0);
      }
    }
    EXPECT_EQ(low, 0);
    const bool splits = criterion == OrderCriterion::thirds || criterion == OrderCriterion::cross_validation;
    EXPECT_GE(right, splits ? 20 : 30) << static_cast<int>(criterion);  // splits are known to overfit oftener
  }
}

TEST(SelectOrder, TooFewDataIsNamed) {
  const std::vector<double> none;
  EXPECT_EQ(select_order(none, none).outcome, Outcome::too_few_data);
}

TEST(PairsApproximate, ExactOnNoiseFreeData) {
  const Data data = curve_data(30, 0.0, 1);
  const PairsApproximate fit = approximate_pairs_fit(data.d, data.y, 2);
  ASSERT_EQ(fit.outcome, Outcome::converged);
  EXPECT_NEAR(fit.alpha(0), 0.0525, 1e-10);
  EXPECT_NEAR(fit.alpha(1), 0.8838, 1e-10);
  EXPECT_NEAR(fit.alpha(2), 0.0584, 1e-10);
}

TEST(PairsApproximate, PrintedSigmaIsHighOnThisCurveAndTheReweightedOneIsRight) {
  const Data data = curve_data(20000, 0.01, seed_from("PairsApproximate.Sigma"));
  const PairsApproximate fit = approximate_pairs_fit(data.d, data.y, 2);
  // the standard deviation of sigma from 20000 readings is 0.5 %; four of them
  EXPECT_NEAR(std::sqrt(fit.sigma_e_sq_reweighted), 0.01, 0.0002);
  double expected = 0.0;  // mean of (f/d)^4 over the readings: what the printed one estimates, over sigma_e^2
  for (const double d : data.d) expected += std::pow((0.0525 + 0.8838 * d + 0.0584 * d * d) / d, 4) / 20000.0;
  EXPECT_NEAR(fit.sigma_e_sq_printed / 1e-4, expected, 0.05 * expected);
  EXPECT_GT(fit.sigma_e_sq_printed, 1.1 * 1e-4);
}

TEST(PairsApproximate, CovariancePredictsTheScatter) {
  // y = f + sigma d^2 e, where the method is exact: 400 fits, the variance of a z-score is 1 +- 4 sqrt(2/400)
  std::vector<double> d;
  for (int k = 0; k < 40; ++k) d.push_back(0.3 + 0.12 * k);
  double square = 0.0;
  for (std::uint64_t repeat = 0; repeat < 400; ++repeat) {
    Random random(seed_from("PairsApproximate.Covariance", {repeat}));
    std::vector<double> y;
    for (const double x : d) y.push_back(0.05 + 0.9 * x + 0.01 * x * x * random.normal());
    const PairsApproximate fit = approximate_pairs_fit(d, y, 1);
    square += std::pow(fit.alpha(1) - 0.9, 2) / fit.alpha_covariance(1, 1) / 400.0;
  }
  EXPECT_NEAR(square, 1.0,
              0.35);  // 0.28 from above, and 38 degrees of freedom add 5 % to a t-variable's variance
}

TEST(SelectOrder, CriteriaByName) {
  for (const OrderCriterion criterion : {OrderCriterion::aic, OrderCriterion::aicc, OrderCriterion::bic,
                                         OrderCriterion::cross_validation, OrderCriterion::thirds})
    EXPECT_EQ(order_criterion_from_string(to_string(criterion)), criterion);
  EXPECT_STREQ(to_string(OrderCriterion::cross_validation), "cv");
  EXPECT_EQ(order_criterion_from_string("cross-validation"), OrderCriterion::cross_validation);
  EXPECT_THROW(order_criterion_from_string("best"), InputError);
}

}  // namespace
}  // namespace rangecal
