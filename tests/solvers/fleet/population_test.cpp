// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/fleet/population.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/distributions/fisher_f.hpp>
#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/fleet/judgement.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "solvers/fleet/unit_readings.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

const VectorXd mu{{0.05, 0.9, 0.05, std::log(0.02)}};
MatrixXd root_of_Sigma() {
  MatrixXd root = VectorXd{{0.02, 0.03, 0.01, 0.2}}.asDiagonal();
  root(1, 0) = -0.02;  // offset and slope go against each other
  return root;
}

VectorXd draw_unit(Random& random) {
  return mu + root_of_Sigma() * VectorXd::NullaryExpr(4, [&](Eigen::Index) { return random.normal(); });
}

Recording readings_of(const VectorXd& theta, int count, Random& random) {
  return testing::unit_readings(theta, 0.3, count, random);
}

UnitSummary summary_of(const Recording& recording) {
  const auto unit = summarise(full_pairs(make_pairs_problem({&recording, 1})).calibration);
  EXPECT_TRUE(unit);
  return *unit;
}

UnitStream stream_of(const std::vector<UnitSummary>& units) {
  return [&units](const std::function<void(const UnitSummary&)>& visit) {
    for (const UnitSummary& unit : units) visit(unit);
  };
}

Population true_population() {
  Population population;
  population.outcome = Outcome::converged;
  population.range_min_m = 0.3;
  population.range_max_m = 5.0;
  population.mean = mu;
  population.covariance = root_of_Sigma() * root_of_Sigma().transpose();
  return population;
}

TEST(Population, OfExactUnitsIsMeanAndCovariance) {
  // With information without end the restricted likelihood is that of a normal sample: its mean and its
  // covariance, of N - 1 degrees of freedom; what is not known of the mean is that over N.
  Random random(seed_from("population exact"));
  std::vector<UnitSummary> units;
  VectorXd mean = VectorXd::Zero(4);
  for (int i = 0; i < 500; ++i) {
    units.push_back({draw_unit(random), 1e16 * MatrixXd::Identity(4, 4)});
    mean += units.back().theta / 500.0;
  }
  MatrixXd covariance = MatrixXd::Zero(4, 4);
  for (const UnitSummary& u : units) covariance += (u.theta - mean) * (u.theta - mean).transpose() / 499.0;
  const Population population = fit_population(stream_of(units));
  ASSERT_EQ(population.outcome, Outcome::converged) << population.reason;
  EXPECT_EQ(population.units, 500);
  EXPECT_LT((population.mean - mean).norm(), 1e-6);
  EXPECT_LT((population.covariance - covariance).norm(), 1e-6 * covariance.norm());
  EXPECT_LT((population.mean_covariance - covariance / 500.0).norm(), 1e-6 * covariance.norm() / 500.0);
}

TEST(Population, SmallFleetsHoldTheirIntervals) {
  // Eight units of 60 readings: nearly all that a posterior knows comes from the mean of the others, which is
  // an estimate. 60 fleets of units that scatter, and 60 of units that do not; how often 95 % intervals of
  // each alpha hold.
  for (const bool alike : {false, true}) {
    Random random(seed_from("population small", {alike ? 1u : 0u}));
    int held[3] = {}, intervals = 0;
    for (int fleet = 0; fleet < 60; ++fleet) {
      std::vector<UnitSummary> units;
      std::vector<VectorXd> truth;
      for (int i = 0; i < 8; ++i) {
        truth.push_back(alike ? mu : draw_unit(random));
        units.push_back(summary_of(readings_of(truth.back(), 60, random)));
      }
      const Population population = fit_population(stream_of(units));
      ASSERT_TRUE(population.outcome == Outcome::converged || population.outcome == Outcome::not_converged)
          << population.reason;
      for (std::size_t i = 0; i < units.size(); ++i) {
        const UnitPosterior posterior = shrink(units[i], population);
        ++intervals;
        for (int a = 0; a < 3; ++a)
          held[a] += std::abs(posterior.mean[a] - truth[i][a]) < 1.96 * std::sqrt(posterior.covariance(a, a));
      }
    }
    // 480 intervals, those of a fleet not independent: 0.95 less four binomial standard deviations of 60
    // would be 0.84. Units that scatter are held in 91 to 93 %, since a covariance of eight units is a guess;
    // those that do not in 95 to 97 %.
    for (const int count : held) EXPECT_GT(count, 0.86 * intervals) << alike;
  }
}

TEST(Population, ComesBackFromReadings) {
  Random random(seed_from("population readings"));
  std::vector<UnitSummary> units;
  constexpr int count = 600;
  for (int i = 0; i < count; ++i) units.push_back(summary_of(readings_of(draw_unit(random), 100, random)));
  const Population population = fit_population(stream_of(units));
  ASSERT_EQ(population.outcome, Outcome::converged) << population.reason;
  const MatrixXd Sigma = true_population().covariance;
  for (int i = 0; i < 4; ++i) {
    // spread of the mean: sqrt((Sigma + Lambda^-1) / N); of a variance: 2 (Sigma + Lambda^-1)^2 / N; 4
    // standard deviations.
    const MatrixXd inverse = units[0].information.inverse();
    const double total = Sigma(i, i) + inverse(i, i);
    EXPECT_NEAR(population.mean[i], mu[i], 4.0 * std::sqrt(total / count)) << i;
    EXPECT_NEAR(population.covariance(i, i), Sigma(i, i), 4.0 * total * std::sqrt(2.0 / count)) << i;
  }
}

TEST(Population, ShortUnitsDoNotPullTheNoise) {
  // sigma^ of 40 readings and three coefficients: E log sigma^ - log sigma = (psi(18.5) - log 20) / 2 =
  // (2.8905 - 2.9957) / 2 = -0.0526, var log sigma^ = psi'(18.5) / 4 = 0.0139, where 1 / (2 N) is 0.0125. The
  // mean of 1500 corrected ones within four standard deviations, their variance within four of its own.
  Random random(seed_from("population short"));
  constexpr int count = 1500;
  double error = 0.0, square = 0.0, stated = 0.0;
  std::vector<UnitSummary> units;
  for (int i = 0; i < count; ++i) {
    const VectorXd theta = draw_unit(random);
    units.push_back(summary_of(readings_of(theta, 40, random)));
    const double e = units.back().theta[3] - theta[3];
    error += e / count;
    square += e * e / count;
    stated += 1.0 / units.back().information(3, 3) / count;
  }
  EXPECT_NEAR(error, 0.0, 4.0 * std::sqrt(0.0139 / count));
  EXPECT_NEAR(square / stated, 1.0, 4.0 * std::sqrt(2.0 / count));
  const Population population = fit_population(stream_of(units));
  ASSERT_EQ(population.outcome, Outcome::converged) << population.reason;
  const double scatter = true_population().covariance(3, 3), total = scatter + 0.0139;
  EXPECT_NEAR(population.mean[3], mu[3], 4.0 * std::sqrt(total / count));
  EXPECT_NEAR(population.covariance(3, 3), scatter, 4.0 * total * std::sqrt(2.0 / count));
}

TEST(Population, NoiseThatCountsTheCoefficientsLosesThemOnce) {
  // sigma of `marginal` counts the coefficients: only the log's expectation is left, (psi(N / 2) - log(N /
  // 2)) / 2 < 0.
  Random random(seed_from("population reml"));
  const Recording recording = readings_of(mu, 60, random);
  const Calibration own = marginal_pairs(make_pairs_problem({&recording, 1})).calibration;
  const auto unit = summarise(own);
  ASSERT_TRUE(unit);
  const double off = unit->theta[3] - std::log(own.noise.parameters[0]);
  EXPECT_GT(off, 0.0);
  EXPECT_LT(off, 0.012);  // 1 / (2 nu), nu = 57 or a little less: 0.0088
  EXPECT_LT((unit->information.topLeftCorner(3, 3).inverse() - *own.alpha_covariance).norm(),
            1e-6 * own.alpha_covariance->norm());
}

TEST(Population, ClosedFormsThatCountTheCoefficientsLoseThemOnce) {
  // They divide by N - p: -(psi(28.5) - log(28.5)) / 2 = 1 / (4 * 28.5) + 1 / (24 * 28.5^2) = 0.00882 for 60
  // readings and p = 3. By eq. 26, which divides by N, -(psi(28.5) - log(30)) / 2 = 0.00882 + log(60 / 57) /
  // 2 = 0.03447.
  Random random(seed_from("population closed forms"));
  const Recording recording = readings_of(mu, 60, random);
  ClosedFormOptions options;
  options.order = 2;
  struct Case {
    Calibration own;
    double off;
  };
  std::vector<Case> cases;
  options.noise_law = NoiseLaw::constant;
  cases.push_back({closed_form_pairs(recording, options), 0.00882});
  options.noise_law = NoiseLaw::f_squared;
  cases.push_back({approximate_pairs(recording, options), 0.00882});
  options.noise_law = NoiseLaw::d_squared;
  cases.push_back({approximate_pairs(recording, options), 0.03447});
  for (Case& c : cases) {
    SCOPED_TRACE(to_string(c.own.method));
    c.own.counts.used = 60;
    const auto unit = summarise(c.own);
    ASSERT_TRUE(unit);
    EXPECT_NEAR(unit->theta[3] - std::log(c.own.noise.parameters[0]), c.off, 1e-5);
    // alpha's covariance is that by N - p already.
    EXPECT_LT((unit->information.topLeftCorner(3, 3).inverse() - *c.own.alpha_covariance).norm(),
              1e-6 * c.own.alpha_covariance->norm());
  }
}

TEST(Population, PosteriorsCoverTheirUnits) {
  // Share of true alpha_1 within 1.96 posterior deviations over 500 new units of 4 readings: binomial, 4 *
  // 0.0097. Fewer readings than unknowns: alone they determine nothing.
  const Population population = true_population();
  Random random(seed_from("population coverage"));
  int held = 0;
  for (int i = 0; i < 500; ++i) {
    const VectorXd theta = draw_unit(random);
    const Recording recording = readings_of(theta, 4, random);
    const Calibration fit = calibrate_in_population(make_pairs_problem({&recording, 1}), population);
    ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
    held += std::abs(fit.alpha[1] - theta[1]) < 1.96 * std::sqrt((*fit.alpha_covariance)(1, 1));
  }
  EXPECT_NEAR(held / 500.0, 0.95, 0.039);
}

TEST(Population, SigmaOfFewReadingsIsNeitherLowNorOversure) {
  // The maximum of alpha and sigma together has sigma low by half a unit of log where four readings meet four unknowns. z of log
  // sigma over 400 new units: mean 0 +- 4 / sqrt(400), rms 1 +- 4 / sqrt(800).
  const Population population = true_population();
  for (const int readings : {3, 6, 12, 30}) {
    SCOPED_TRACE(readings);
    Random random(seed_from(fmt::format("population sigma {}", readings)));
    double sum = 0.0, squares = 0.0;
    for (int i = 0; i < 400; ++i) {
      const VectorXd theta = draw_unit(random);
      const Recording recording = readings_of(theta, readings, random);
      const Calibration fit = calibrate_in_population(make_pairs_problem({&recording, 1}), population);
      ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
      const Estimate sigma = fit.noise_estimates.at(0);
      const double z = (std::log(sigma.value) - theta[3]) / (*sigma.std_dev / sigma.value);
      sum += z;
      squares += z * z;
    }
    EXPECT_NEAR(sum / 400.0, 0.0, 0.2);
    EXPECT_NEAR(std::sqrt(squares / 400.0), 1.0, 0.142);
  }
}

TEST(Population, NoReadingsGiveThePopulationAndManyTheUnit) {
  const Population population = true_population();
  const Calibration none = calibrate_in_population(PairsProblem{}, population);
  EXPECT_LT((none.alpha - mu.head(3)).norm(), 1e-9);
  EXPECT_LT((*none.alpha_covariance - population.covariance.topLeftCorner(3, 3)).norm(), 1e-9);
  Random random(seed_from("population many"));
  const Recording recording = readings_of(draw_unit(random), 20000, random);
  const PairsProblem problem = make_pairs_problem({&recording, 1});
  const Calibration many = calibrate_in_population(problem, population),
                    own = full_pairs(problem).calibration;
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(many.alpha[i], own.alpha[i], 0.2 * std::sqrt((*own.alpha_covariance)(i, i)));
  // shrink() is the same to the order of the quadratic approximation
  const UnitPosterior posterior = shrink(*summarise(own), population);
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(posterior.mean[i], many.alpha[i], 0.02 * std::sqrt((*own.alpha_covariance)(i, i)));
}

TEST(Population, OutlyingUnitsAreNamedAndDoNotMoveIt) {
  Random random(seed_from("population outliers"));
  std::vector<UnitSummary> clean;
  for (int i = 0; i < 300; ++i) clean.push_back({draw_unit(random), 1e8 * MatrixXd::Identity(4, 4)});
  std::vector<UnitSummary> mixed = clean;
  for (int i = 0; i < 12; ++i) {  // 4 %: an offset ten deviations off
    mixed.push_back({draw_unit(random), 1e8 * MatrixXd::Identity(4, 4)});
    mixed.back().theta[0] += 0.2;
  }
  const Population a = fit_population(stream_of(clean)), b = fit_population(stream_of(mixed));
  ASSERT_EQ(b.outcome, Outcome::converged);
  EXPECT_EQ(b.left_out, 12 + a.left_out);
  EXPECT_LT((a.covariance - b.covariance).norm(), 1e-6);
  const FleetJudge judge(stream_of(mixed), b);
  for (std::size_t i = 300; i < mixed.size(); ++i) {
    EXPECT_TRUE(b.outlying[i]);
    const UnitJudgement judged = judge(mixed[i], i);
    EXPECT_LT(judged.p_value, 1e-6);
    EXPECT_GT(judged.t[0], 5.0);
  }
}

TEST(Population, MisfitSeesShapeTailsAndDependenceAtTheirRate) {
  Random random(seed_from("population misfit"));
  int alarms = 0;
  for (int i = 0; i < 300; ++i) {
    const Recording recording = readings_of(mu, 400, random);
    const UnitMisfit misfit =
        unit_misfit(recording, full_pairs(make_pairs_problem({&recording, 1})).calibration);
    alarms += (misfit.shape_p < 0.01) + (misfit.tail_p < 0.01) + (misfit.dependence_p < 0.01);
  }
  EXPECT_LT(alarms, 22);  // 9 expected of 900, four binomial deviations
  // f has order 8 at most: beside order 7 there is one more coefficient to ask for, beside order 8 none
  PairsOptions high;
  high.order = 7;
  const Recording plain = readings_of(mu, 400, random);
  const PairsProblem problem = make_pairs_problem({&plain, 1});
  const PairsFit seventh = full_pairs(problem, high);
  high.order = 8;
  const PairsFit eighth = full_pairs(problem, high);
  // one coefficient more, nine in all: F = (exp(ratio / N) - 1) (N - 9) ~ F(1, N - 9), where sigma^ squared
  // is of ratio exp(ratio / N)
  const double ratio = std::max(0.0, 2.0 * (seventh.nll - eighth.nll));
  EXPECT_NEAR(unit_misfit(plain, seventh.calibration).shape_p,
              cdf(complement(boost::math::fisher_f(1.0, 391.0), 391.0 * std::expm1(ratio / 400.0))), 1e-6);
  EXPECT_EQ(unit_misfit(plain, eighth.calibration).shape_p, 1.0);
  EXPECT_EQ(unit_misfit(plain, eighth.calibration).shape_m, 0.0);
  Recording odd = readings_of(mu, 400, random);
  for (std::size_t i = 0; i < odd.pairs.size(); ++i)
    odd.pairs.reading_m[i] += 0.05 * std::sin(3.0 * odd.pairs.true_m[i]);
  EXPECT_LT(unit_misfit(odd, full_pairs(make_pairs_problem({&odd, 1})).calibration).shape_p, 1e-6);
  odd = readings_of(mu, 400, random);
  for (std::size_t i = 0; i < odd.pairs.size(); i += 20) odd.pairs.reading_m[i] *= 1.3;
  EXPECT_LT(unit_misfit(odd, full_pairs(make_pairs_problem({&odd, 1})).calibration).tail_p, 1e-6);
}

TEST(Population, TailsOfShortUnitsAlarmAtTheirRate) {
  // Sound units of 30, 40 and 100 readings. Shares of tail_p below 0.01 and 0.001: at most these, four
  // binomial deviations; a kurtosis taken for normal has 0.006 below 0.001 at 100 readings. Not below half of
  // it either: light tails are called more seldom.
  for (const int readings : {30, 40, 100}) {
    Random random(seed_from("population tails", {static_cast<std::uint64_t>(readings)}));
    constexpr int count = 4000;
    int below[2] = {};
    for (int i = 0; i < count; ++i) {
      const Recording recording = readings_of(mu, readings, random);
      const UnitMisfit misfit =
          unit_misfit(recording, full_pairs(make_pairs_problem({&recording, 1})).calibration);
      below[0] += misfit.tail_p < 0.01;
      below[1] += misfit.tail_p < 0.001;
    }
    for (const int k : {0, 1}) {
      const double expected = (k ? 0.001 : 0.01) * count;
      EXPECT_LT(below[k], expected + 4.0 * std::sqrt(expected)) << readings;
      EXPECT_GT(below[k], 0.5 * expected - 4.0 * std::sqrt(0.5 * expected)) << readings;
    }
  }
  Random random(seed_from("population tails power"));
  Recording odd = readings_of(mu, 60, random);
  for (std::size_t i = 0; i < odd.pairs.size(); i += 20) odd.pairs.reading_m[i] *= 1.5;
  EXPECT_LT(unit_misfit(odd, full_pairs(make_pairs_problem({&odd, 1})).calibration).tail_p, 1e-4);
}

TEST(Population, RefusesAStreamThatChangesBetweenPasses) {
  Random random(seed_from("population stream"));
  std::vector<UnitSummary> units;
  for (int i = 0; i < 20; ++i) units.push_back({draw_unit(random), 1e8 * MatrixXd::Identity(4, 4)});
  const UnitSummary narrow{VectorXd::Zero(3), MatrixXd::Identity(3, 3)};
  // The first pass counts, five each look for three quantiles, the others fit: it changes in the second, the tenth, the
  // seventeenth and the eighteenth.
  for (const int last : {1, 9, 16, 17})
    for (const int kind : {0, 1, 2}) {
      int pass = 0;
      const UnitStream changing = [&](const std::function<void(const UnitSummary&)>& visit) {
        const bool changed = ++pass > last;
        for (std::size_t i = 0; i + 1 < units.size(); ++i) visit(units[i]);
        if (!changed || kind == 0) visit(units.back());  // one more, one fewer, one of another order
        if (changed && kind == 0) visit(units.back());
        if (changed && kind == 2) visit(narrow);
      };
      EXPECT_THROW(fit_population(changing), InputError) << last << ' ' << kind;
    }
}

TEST(Population, SaysWhenItCannot) {
  std::vector<UnitSummary> few{{mu, MatrixXd::Identity(4, 4)}};
  EXPECT_EQ(fit_population(stream_of(few)).outcome, Outcome::too_few_data);
  EXPECT_THROW(calibrate_in_population(PairsProblem{}, Population{}), InputError);
  few.push_back({VectorXd::Zero(3), MatrixXd::Identity(3, 3)});
  EXPECT_THROW(fit_population(stream_of(few)), InputError);
  std::vector<UnitSummary> blind(8, {mu, MatrixXd::Identity(4, 4)});
  blind[5].information(2, 2) = 0.0;
  EXPECT_THAT([&] { fit_population(stream_of(blind)); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("not positive definite")));
  Calibration none;
  EXPECT_FALSE(summarise(none));
  const Population population = true_population(),
                   back = population_from_json(population_to_json(population), "p");
  EXPECT_EQ(back.mean, population.mean);
  EXPECT_EQ(back.covariance, population.covariance);
  EXPECT_EQ(back.mean_covariance.size(), 0);
  EXPECT_THROW(population_from_json("{}", "p"), InputError);
  std::string wider = population_to_json(population);
  wider.replace(wider.find("\"mean\": ["), 9, "\"mean\": [0.0, ");
  EXPECT_THAT([&] { population_from_json(wider, "p"); },
              ::testing::ThrowsMessage<InputError>("p: field 'covariance': is not 5 rows"));
  Population torn = population;  // a correlation of two
  torn.covariance(0, 1) = torn.covariance(1, 0) =
      2.0 * std::sqrt(population.covariance(0, 0) * population.covariance(1, 1));
  EXPECT_THROW(shrink({mu, MatrixXd::Identity(4, 4)}, torn), InputError);
  EXPECT_THROW(calibrate_in_population(PairsProblem{}, torn), InputError);
}

}  // namespace
}  // namespace rangecal
