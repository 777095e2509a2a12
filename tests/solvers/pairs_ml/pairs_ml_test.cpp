// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <Eigen/LU>
#include <array>
#include <boost/math/distributions/normal.hpp>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/solvers/nlopt/nlopt_check.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ceres.hpp"
#include "support/recordings.hpp"

namespace rangecal {
namespace {

const Eigen::Vector3d true_alpha(0.0525, 0.8838, 0.0584);

PairsProblem simulate(std::uint64_t seed, int rows, double sigma = 0.02, int distances = 0) {
  Random random(seed);
  std::vector<double> d, y;
  for (int i = 0; i < rows; ++i) {
    d.push_back(distances > 0
                    ? 0.5 + 4.0 * static_cast<double>(random.index(static_cast<std::uint64_t>(distances))) /
                                distances
                    : random.uniform(0.2, 5.0));
    const double f = evaluate_polynomial(true_alpha, d.back());
    y.push_back(f + sigma * f * f * random.normal());
  }
  return make_pairs_problem(d, y);
}

/// d_i = 0.2 + 4.8 i / 199, y = f + 0.02 f^2 z, z the normal quantile of ((73 i) mod 200 + 1/2) / 200.
PairsProblem quantile_problem() {
  std::vector<double> d, y;
  for (int i = 0; i < 200; ++i) {
    d.push_back(0.2 + 4.8 * i / 199.0);
    const double f = evaluate_polynomial(true_alpha, d.back());
    const double z = boost::math::quantile(boost::math::normal(), ((73 * i) % 200 + 0.5) / 200.0);
    y.push_back(f + 0.02 * f * f * z);
  }
  return make_pairs_problem(d, y);
}

TEST(FullPairs, AgreesWithSciPyAndR) {
  // The exact NLL in (alpha, log sigma), law f^2, with analytic gradient, from alpha = (0.05, 0.9, 0.06),
  // sigma = 0.03. SciPy 1.10.1: minimize(nll, x0, jac=grad, hess=hess, method='trust-exact',
  // options={'gtol': 1e-12}); largest gradient entry at the end 1.8e-8.
  const double scipy[5] = {0.050227802542800445, 0.8886732335063259, 0.05729935676417259,
                           0.019711064574525546, -178.45733601084578};
  // R 4.2.2: optim(x, nll, gr, method = "BFGS", control = list(reltol = 1e-15)) over the orthonormal columns of
  // qr.Q(qr(cbind(1, d, d^2))), restarted six times; alpha by qr.solve.
  const double r[5] = {0.0502278022456215, 0.8886732337306994, 0.0572993567252590, 0.0197110645822593,
                       -178.4573360108551299};
  const PairsFit fit = full_pairs(quantile_problem());
  ASSERT_EQ(fit.calibration.outcome, Outcome::converged);
  EXPECT_LT(fit.gradient_norm, 1e-8);
  for (const double* reference : {scipy, r}) {
    for (int k = 0; k < 3; ++k)
      EXPECT_NEAR(fit.calibration.alpha[k], reference[k], 1e-6 * std::abs(reference[k]));
    EXPECT_NEAR(fit.calibration.noise.parameters[0], reference[3], 1e-6 * reference[3]);
    EXPECT_NEAR(fit.nll, reference[4], 1e-6);
  }
}

const std::string certified_folder = std::string(RANGECAL_SOURCE_DIR) + "/tests/data/certified/";

std::map<std::string, PairsProblem> certified_problems() {
  std::map<std::string, std::array<std::vector<double>, 2>> rows;
  std::ifstream file(certified_folder + "data.csv");
  std::string name, d, y;
  std::getline(file, name);
  while (std::getline(file, name, ',') && std::getline(file, d, ',') && std::getline(file, y)) {
    rows[name][0].push_back(std::stod(d));
    rows[name][1].push_back(std::stod(y));
  }
  std::map<std::string, PairsProblem> problems;
  for (const auto& [key, columns] : rows) problems[key] = make_pairs_problem(columns[0], columns[1]);
  return problems;
}

/// Log relative error, as NIST's StRD counts digits: -log10 |value - certified| / |certified|, from 0 to 15.9.
double certified_digits(double value, double certified) {
  if (value == certified) return 15.9;
  return std::clamp(-std::log10(std::abs(value - certified) / std::abs(certified)), 0.0, 15.9);
}

TEST(CertifiedPairs, TenDigitsOfEstimatesAndNll) {
  // Maximum likelihood to 30 digits by another program in another arithmetic: tests/data/certified/README.md.
  std::ifstream file(certified_folder + "certified.json");
  const nlohmann::json certified = nlohmann::json::parse(file);
  const auto problems = certified_problems();
  ASSERT_EQ(certified["problems"].size(), 20u);
  fmt::print("{:40}digits of full_pairs           of full_pairs_ceres\n", "");
  fmt::print("problem      law      order  N     kept  alpha  sigma    NLL    std    alpha  sigma    NLL\n");
  for (const nlohmann::json& p : certified["problems"]) {
    const std::string name = p["name"];
    SCOPED_TRACE(name);
    const PairsProblem& problem = problems.at(name);
    ASSERT_EQ(problem.readings(), p["readings"].get<double>());
    PairsOptions options;
    options.order = p["order"].get<int>();
    options.law = noise_law_from_string(p["law"]);
    const PairsFit fit = full_pairs(problem, options);
    ASSERT_EQ(fit.calibration.outcome, Outcome::converged) << fit.calibration.reason;
    const PairsCeresResult ceres = full_pairs_ceres(problem, *options.order, options.law);

    const auto number = [](const nlohmann::json& text) { return std::stod(text.get<std::string>()); };
    const std::vector<double> kept = p["digits_kept_by_rounded_data"];  // of alpha_0 .. alpha_n, sigma
    double alpha = 15.9, std_digits = 15.9, ceres_alpha = 15.9;
    for (int j = 0; j <= *options.order; ++j) {
      const auto k = static_cast<std::size_t>(j);
      const double expected = number(p["alpha"][k]), deviation = number(p["alpha_std"][k]);
      alpha = std::min(alpha, certified_digits(fit.calibration.alpha[j], expected));
      std_digits = std::min(
          std_digits, certified_digits(std::sqrt((*fit.calibration.alpha_covariance)(j, j)), deviation));
      ceres_alpha = std::min(ceres_alpha, certified_digits(ceres.alpha[j], expected));
      // Ceres takes no step whose gain drowns in the cost's rounding.
      EXPECT_NEAR(ceres.alpha[j], expected, 1e-6 * deviation);
    }
    const double sigma = certified_digits(fit.calibration.noise.parameters[0], number(p["sigma"]));
    const double nll = certified_digits(fit.nll, number(p["nll"]));
    const double ceres_sigma = certified_digits(ceres.noise.parameters[0], number(p["sigma"]));
    const double ceres_nll = certified_digits(ceres.nll, number(p["nll"]));
    fmt::print("{:12} {:8} {:5} {:4} {:6.1f} {:6.1f} {:6.1f} {:6.1f} {:6.1f}   {:6.1f} {:6.1f} {:6.1f}\n",
               name, to_string(options.law), *options.order, problem.readings(),
               *std::min_element(kept.begin(), kept.end()), alpha, sigma, nll, std_digits, ceres_alpha,
               ceres_sigma, ceres_nll);
    // Of `quiet` the readings, rounded to doubles, hold sigma to 9.5 digits; the solver rounds f as well, a digit more.
    const double wanted_of_sigma = std::min(10.0, kept.back() - 1.0);
    EXPECT_GE(alpha, 10.0);
    EXPECT_GE(sigma, wanted_of_sigma);
    EXPECT_GE(std_digits, wanted_of_sigma);  // a multiple of sigma
    EXPECT_GE(nll, 10.0);
    ASSERT_EQ(ceres.outcome, Outcome::converged) << ceres.reason;
    EXPECT_GE(ceres_nll, 10.0);
  }
}

TEST(FullPairs, EveryLawReachesItsOptimum) {
  for (std::uint64_t instance = 0; instance < 20; ++instance) {
    const PairsProblem problem =
        simulate(seed_from("FullPairs.EveryLaw", {instance}), 150, 0.03, instance % 2 ? 25 : 0);
    for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed,
                               NoiseLaw::d_squared, NoiseLaw::polynomial}) {
      for (int order = 0; order <= 5; ++order) {
        SCOPED_TRACE(std::string(to_string(law)) + " order " + std::to_string(order) + " case " +
                     std::to_string(instance));
        PairsOptions options;
        options.law = law;
        options.order = order;
        const PairsFit fit = full_pairs(problem, options);
        if (law == NoiseLaw::polynomial && fit.calibration.outcome != Outcome::converged) {
          // A noise polynomial may touch 0 inside of the range: there is no optimum then, and it is said.
          EXPECT_FALSE(fit.calibration.reason.empty());
          continue;
        }
        ASSERT_EQ(fit.calibration.outcome, Outcome::converged) << fit.calibration.reason;
        EXPECT_LT(fit.gradient_norm, 1e-6);
        EXPECT_NEAR(
            fit.nll, pairs_nll(problem, fit.calibration.alpha, fit.calibration.noise),
            1e-9 * (1.0 + std::abs(fit.nll)));  // streaming and plain sum, rounding of some hundred terms
        EXPECT_EQ(fit.calibration.joint_nll, fit.calibration.marginal_nll);
      }
    }
  }
}

TEST(FullPairs, FallingCurvesConverge) {
  // An infrared sensor whose reading falls with distance: noise s f^2 of a small f lets log sigma run away from its start.
  for (const int order : {1, 2})
    for (const NoiseLaw law : {NoiseLaw::f_squared, NoiseLaw::f_cubed, NoiseLaw::f}) {
      SCOPED_TRACE(fmt::format("order {}, {}", order, to_string(law)));
      Random random(seed_from(fmt::format("falling {} {}", order, to_string(law))));
      const Eigen::VectorXd alpha = order == 1 ? Eigen::VectorXd(Eigen::Vector2d(6.0, -0.8))
                                               : Eigen::VectorXd(Eigen::Vector3d(6.0, -1.1, 0.05));
      std::vector<double> d, y;
      for (int i = 0; i < 400; ++i) {
        d.push_back(random.uniform(0.3, 5.0));
        const double f = evaluate_polynomial(alpha, d.back());
        y.push_back(f + 0.01 *
                            std::pow(f, law == NoiseLaw::f           ? 1
                                        : law == NoiseLaw::f_squared ? 2
                                                                     : 3) *
                            random.normal());
      }
      PairsOptions options;
      options.order = order;
      options.law = law;
      const Calibration fit = full_pairs(make_pairs_problem(d, y), options).calibration;
      ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
      for (int i = 0; i <= order; ++i)
        EXPECT_NEAR(fit.alpha[i], alpha[i], 4.0 * std::sqrt((*fit.alpha_covariance)(i, i)));
      EXPECT_NEAR(fit.noise.parameters[0], 0.01, 0.0015);  // 4 sd of sigma / sqrt(2 N)
    }
}

TEST(FullPairs, CellsAndRowsHaveOneOptimum) {
  const PairsProblem cells = simulate(seed_from("FullPairs.CellsAndRows"), 400, 0.03, 20);
  const PairsFit a = full_pairs(cells), b = full_pairs(pairs_as_rows(cells));
  EXPECT_NEAR(a.nll, b.nll, 1e-9 * std::abs(a.nll));
  EXPECT_LT((a.calibration.alpha - b.calibration.alpha).norm(), 1e-9 * a.calibration.alpha.norm());
}

TEST(FullPairs, SameBitsForAnyNumberOfThreads) {
  const PairsProblem problem = simulate(seed_from("FullPairs.Threads"), 100000);
  const PairsFit many = full_pairs(problem);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const PairsFit single = full_pairs(problem);
  PairsOptions serial;
  serial.parallel_from = 1 << 30;
  const PairsFit plain = full_pairs(problem, serial);
  ASSERT_EQ(many.calibration.outcome, Outcome::converged);
  for (int k = 0; k < 3; ++k) {
    EXPECT_EQ(many.calibration.alpha[k], single.calibration.alpha[k]);
    EXPECT_EQ(many.calibration.alpha[k], plain.calibration.alpha[k]);
  }
  EXPECT_EQ(many.nll, single.nll);
  EXPECT_LT(many.gradient_norm, 1e-6);
}

TEST(FullPairs, CeresReachesTheSameOptimum) {
  for (std::uint64_t instance = 0; instance < 10; ++instance) {
    const PairsProblem problem =
        simulate(seed_from("FullPairs.Ceres", {instance}), 200, 0.05, instance % 2 ? 30 : 0);
    for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::d_squared}) {
      SCOPED_TRACE(std::string(to_string(law)) + " case " + std::to_string(instance));
      PairsOptions options;
      options.law = law;
      const PairsFit fit = full_pairs(problem, options);
      const PairsCeresResult other = full_pairs_ceres(problem, 2, law);
      ASSERT_EQ(other.outcome, Outcome::converged) << other.reason;
      EXPECT_NEAR(other.nll, fit.nll, 1e-8);
      EXPECT_LT(other.gradient_norm, 1e-6);
    }
  }
}

TEST(FullPairs, NloptFindsNothingBetter) {
  for (std::uint64_t instance = 0; instance < 20; ++instance) {
    SCOPED_TRACE(instance);
    const PairsProblem problem = simulate(seed_from("FullPairs.Nlopt", {instance}), 100, 0.05);
    const PairsFit fit = full_pairs(problem);
    NloptProblem check;
    check.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
      Noise noise;
      noise.parameters = Eigen::VectorXd::Constant(1, std::exp(x[3]));
      const PairsDerivatives at = pairs_derivatives(problem, x.head(3), noise);
      if (gradient) *gradient = at.gradient;
      return at.nll;
    };
    check.seed = Eigen::Vector4d(0.0, 1.0, 0.0, std::log(0.1));
    check.whitening = whitening_from_information(
        pairs_derivatives(problem, check.seed.head(3),
                          Noise{NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.1)})
            .information);
    check.lower = Eigen::Vector4d(-0.5, 0.3, -0.2, -10.0);
    check.upper = Eigen::Vector4d(0.5, 1.6, 0.3, 1.0);
    check.global_indices = {0, 1, 2};
    const NloptCheck result = nlopt_check(check, {.reference_nll = fit.nll, .global_evaluations = 300});
    EXPECT_TRUE(result.agrees) << result.report;
    EXPECT_FALSE(result.better_basin) << result.report;
    EXPECT_NEAR(result.local_nll, fit.nll, 1e-6);
  }
}

TEST(FullPairs, DegenerateDataGetNamedOutcomes) {
  const std::vector<double> same(10, 2.0), readings = {2.1, 2.0, 1.9, 2.05, 1.95, 2.1, 2.0, 1.9, 2.05, 1.95};
  const PairsFit one = full_pairs(make_pairs_problem(same, readings));
  EXPECT_EQ(one.calibration.outcome, Outcome::unobservable);
  EXPECT_NE(one.calibration.reason.find("the one distance 2 m"), std::string::npos) << one.calibration.reason;
  EXPECT_EQ(one.calibration.weakest_direction, "-2 alpha_0 + 1 alpha_1");  // f + c (d - 2) fits alike
  EXPECT_FALSE(one.calibration.alpha_covariance.has_value());
  ASSERT_EQ(one.calibration.order(), 0);

  std::vector<double> two;
  for (int i = 0; i < 10; ++i) two.push_back(i < 5 ? 1.0 : 2.0);
  std::vector<double> at_two = readings;
  for (int i = 0; i < 5; ++i) at_two[static_cast<std::size_t>(i)] -= 1.0;
  EXPECT_EQ(full_pairs(make_pairs_problem(two, at_two)).calibration.outcome, Outcome::unobservable);

  const std::vector<double> few_d = {1.0, 2.0, 3.0}, few_y = {1.1, 2.0, 3.2};
  EXPECT_EQ(full_pairs(make_pairs_problem(few_d, few_y)).calibration.outcome, Outcome::too_few_data);
  EXPECT_EQ(full_pairs(make_pairs_problem({}, {})).calibration.outcome, Outcome::too_few_data);

  PairsProblem none = make_pairs_problem({}, {});  // every reason is counted, the most frequent first
  none.counts.read = 12;
  none.counts.dropped = {{"above range_max_m", 2}, {"missing", 10}, {"zero", 0}};
  EXPECT_EQ(full_pairs(none).calibration.reason,
            "none of 12 readings can be used: 10 missing, 2 above range_max_m");

  std::vector<double> exact_d, exact_y;
  for (int i = 0; i < 20; ++i) {
    exact_d.push_back(0.5 + 0.2 * i);
    exact_y.push_back(evaluate_polynomial(true_alpha, exact_d.back()));
  }
  const PairsFit exact = full_pairs(make_pairs_problem(exact_d, exact_y));
  EXPECT_EQ(exact.calibration.outcome, Outcome::unbounded);
  EXPECT_FALSE(exact.calibration.alpha_covariance.has_value());
  PairsOptions any_order;
  any_order.order.reset();  // and no lower order is called better, for it has noise to show
  const PairsFit found = full_pairs(make_pairs_problem(exact_d, exact_y), any_order);
  EXPECT_EQ(found.calibration.outcome, Outcome::unbounded);
  EXPECT_EQ(found.calibration.order(), 2);
  EXPECT_LT((found.calibration.alpha - true_alpha).norm(), 1e-12);

  // Four distances, repeats rounded alike: a cubic through four means is chance, not truth.
  std::vector<double> four_d, four_y;
  for (int i = 0; i < 20; ++i) {
    four_d.push_back(1.0 + i / 5);
    four_y.push_back(std::array{1.01, 2.03, 2.98, 4.02}[static_cast<std::size_t>(i / 5)]);
  }
  EXPECT_EQ(full_pairs(make_pairs_problem(four_d, four_y), any_order).calibration.outcome,
            Outcome::converged);

  PairsOptions bad;
  bad.order = 99;
  EXPECT_THROW(full_pairs(make_pairs_problem(same, readings), bad), InputError);
}

TEST(FullPairs, OrderByAic) {
  PairsOptions options;
  options.order.reset();
  const PairsFit fit = full_pairs(simulate(seed_from("FullPairs.OrderByAic"), 2000), options);
  ASSERT_EQ(fit.orders.size(), 4u);
  EXPECT_GE(fit.calibration.order(), 2);  // order 1 misses 0.0584 d^2 by many standard deviations
  const OrderScore& score = fit.orders[1];
  EXPECT_DOUBLE_EQ(score.aic, 2.0 * (score.nll + 4.0));
  EXPECT_NEAR(score.aicc, score.aic + 2.0 * 4.0 * 5.0 / 1995.0, 1e-9);
  EXPECT_NEAR(score.bic, 2.0 * score.nll + 4.0 * std::log(2000.0), 1e-9);
  for (const OrderScore& other : fit.orders) EXPECT_GE(other.aic, *fit.calibration.aic - 1e-9);
}

TEST(MarginalPairs, ConstantNoiseIsTheClassicalUnbiasedVariance) {
  // Constant law: REML is the residual sum of squares over N - (n + 1), exactly.
  PairsOptions options;
  options.law = NoiseLaw::constant;
  const PairsProblem problem = simulate(seed_from("MarginalPairs.Constant"), 30);
  const PairsFit full = full_pairs(problem, options), marginal = marginal_pairs(problem, options);
  ASSERT_EQ(marginal.calibration.outcome, Outcome::converged) << marginal.calibration.reason;
  EXPECT_NEAR(marginal.calibration.noise.parameters[0],
              full.calibration.noise.parameters[0] * std::sqrt(30.0 / 27.0), 1e-7);
  EXPECT_LT((marginal.calibration.alpha - full.calibration.alpha).norm(), 1e-8);
  EXPECT_GE(marginal.nll, full.nll);
}

TEST(MarginalPairs, NoiseIsUnbiasedAndCovarianceHolds) {
  // 600 repeats of N = 25, sigma = 0.05: sigma of `full` is low by about 4 / (2 N) = 7 %; of `marginal` within 1 %
  // (its own mean is known to 0.145 / sqrt(600) = 0.6 %). z follows about Student's t with 21 degrees of freedom, whose
  // variance is 21 / 19 = 1.105; within 4 standard errors, 4 sqrt(2 / 600) = 23 %.
  double full_ratio = 0.0, marginal_ratio = 0.0;
  Eigen::Vector3d z_sq = Eigen::Vector3d::Zero();
  const double distances[3] = {0.5, 2.0, 4.0};
  const int repeats = 600;
  for (std::uint64_t repeat = 0; repeat < repeats; ++repeat) {
    const PairsProblem problem = simulate(seed_from("MarginalPairs.Noise", {repeat}), 25, 0.05);
    const PairsFit full = full_pairs(problem), marginal = marginal_pairs(problem);
    ASSERT_EQ(full.calibration.outcome, Outcome::converged);
    ASSERT_EQ(marginal.calibration.outcome, Outcome::converged);
    full_ratio += std::pow(full.calibration.noise.parameters[0] / 0.05, 2) / repeats;
    marginal_ratio += std::pow(marginal.calibration.noise.parameters[0] / 0.05, 2) / repeats;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d powers(1.0, distances[k], distances[k] * distances[k]);
      const double variance = powers.dot(*marginal.calibration.alpha_covariance * powers);
      z_sq[k] += std::pow(powers.dot(marginal.calibration.alpha - true_alpha), 2) / variance / repeats;
    }
  }
  EXPECT_LT(full_ratio, 0.95);
  EXPECT_NEAR(marginal_ratio, 1.0,
              0.03);  // variance: twice the relative spread of sigma, about 2.3 standard errors
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(z_sq[k], 21.0 / 19.0, 0.23) << distances[k];
}

TEST(FullPairs, ShapesAreRecovered) {
  Random random(seed_from("FullPairs.Shapes"));
  std::vector<double> d, y_t, y_mix, y_normal;
  for (int i = 0; i < 3000; ++i) {
    d.push_back(random.uniform(0.2, 5.0));
    const double f = evaluate_polynomial(true_alpha, d.back()), s = 0.005 * f * f;
    double chi = 0.0;
    for (int k = 0; k < 4; ++k) {
      const double u = random.normal();
      chi += u * u;
    }
    y_t.push_back(f + s * random.normal() / std::sqrt(chi / 4.0));
    y_mix.push_back(f + s * random.normal() * (random.uniform() < 0.15 ? 12.0 : 1.0));
    y_normal.push_back(f + s * random.normal());
  }
  PairsOptions options;
  options.shape = NoiseShape::automatic;
  for (const bool marginal : {false, true}) {
    const auto fit_pairs = marginal ? &marginal_pairs : &full_pairs;
    const PairsFit t = fit_pairs(make_pairs_problem(d, y_t), options);
    ASSERT_EQ(t.calibration.outcome, Outcome::converged) << t.calibration.reason;
    EXPECT_EQ(t.shape.shape, NoiseShape::student_t);
    EXPECT_NEAR(t.shape.nu, 4.0, 1.2);  // standard deviation about 0.3
    EXPECT_NEAR(t.calibration.noise.parameters[0], 0.005, 0.0004);
    const PairsFit mixed = fit_pairs(make_pairs_problem(d, y_mix), options);
    ASSERT_EQ(mixed.calibration.outcome, Outcome::converged) << mixed.calibration.reason;
    EXPECT_EQ(mixed.shape.shape, NoiseShape::contaminated);
    EXPECT_NEAR(mixed.shape.outlier_share, 0.15, 0.03);  // 4 standard deviations
    EXPECT_NEAR(mixed.shape.outlier_scale, 12.0, 2.0);
    EXPECT_NEAR(mixed.calibration.noise.parameters[0], 0.005, 0.0004);
    ASSERT_TRUE(mixed.calibration.alpha_covariance.has_value());
    const PairsFit normal = fit_pairs(make_pairs_problem(d, y_normal), options);
    EXPECT_EQ(normal.shape.shape, NoiseShape::gaussian);
    EXPECT_EQ(normal.shapes.size(), 4u);
  }
}

TEST(NloptCheck, FindsABetterBasin) {
  // (x^2 - 1)^2 + 0.2 x: minima near -1 and 1, the one at -1 lower by about 0.4.
  NloptProblem problem;
  problem.objective = [](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    const double v = x[0] * x[0] - 1.0;
    if (gradient) *gradient = Eigen::VectorXd::Constant(1, 4.0 * v * x[0] + 0.2);
    return v * v + 0.2 * x[0];
  };
  problem.seed = Eigen::VectorXd::Constant(1, 1.0);
  problem.whitening = Eigen::MatrixXd::Identity(1, 1);
  const NloptCheck local = nlopt_check(problem);
  EXPECT_NEAR(local.nll, 0.1974, 1e-3);
  problem.lower = Eigen::VectorXd::Constant(1, -3.0);
  problem.upper = Eigen::VectorXd::Constant(1, 3.0);
  problem.global_indices = {0};
  const NloptCheck global = nlopt_check(problem, {.reference_nll = local.nll});
  EXPECT_TRUE(global.better_basin);
  EXPECT_FALSE(global.agrees);
  EXPECT_NEAR(global.x[0], -1.0241, 1e-3);
  problem.whitening = Eigen::MatrixXd::Identity(2, 2);
  EXPECT_THROW(nlopt_check(problem), InputError);
}

TEST(FullPairs, RealRecordingsConverge) {
  const std::filesystem::path root = testing::recordings();
  for (const char* name : {"rangecal/mrclam6-robot1-pairs", "rangecal/wall-sonar-calibration"}) {
    RANGECAL_REQUIRE_RECORDING(root / name);
    const Recording recording[1] = {load_recording((root / name).string())};
    const PairsProblem problem = make_pairs_problem(recording);
    PairsOptions options;
    options.order.reset();
    for (const NoiseShape shape : {NoiseShape::gaussian, NoiseShape::automatic}) {
      options.shape = shape;
      const PairsFit full = full_pairs(problem, options), marginal = marginal_pairs(problem, options);
      EXPECT_EQ(full.calibration.outcome, Outcome::converged) << name << ": " << full.calibration.reason;
      EXPECT_EQ(marginal.calibration.outcome, Outcome::converged)
          << name << ": " << marginal.calibration.reason;
      EXPECT_LE(full.nll, marginal.nll + 1e-6);
      for (std::size_t k = 1; k < full.orders.size();
           ++k) {  // nested models: no order is worse than the one below
        EXPECT_LE(full.orders[k].nll, full.orders[k - 1].nll + 1e-6)
            << name << " order " << full.orders[k].order;
      }
    }
  }
}

}  // namespace
}  // namespace rangecal
