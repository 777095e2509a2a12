// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/fleet/judgement.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "solvers/fleet/unit_readings.hpp"

namespace rangecal {
namespace {

using boost::math::complement;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double unknowns = 4.0;           // of theta
constexpr double offset_m = 0.1;           // ten standard deviations of alpha_0
constexpr double alarm_rate = 0.01 / 4.0;  // of one of the four questions that a fleet is asked

UnitStream stream_over(const std::vector<UnitSummary>& units) {
  return [&units](const std::function<void(const UnitSummary&)>& visit) {
    for (const UnitSummary& unit : units) visit(unit);
  };
}

/// theta of a unit: about the sensor of 2016, with deviations of 0.01 m, 0.02, 0.008 1/m and 20 % of sigma =
/// 0.01 1/m.
VectorXd draw_theta(Random& random) {
  const VectorXd mean{{0.0525, 0.8838, 0.0584, std::log(0.01)}}, deviation{{0.01, 0.02, 0.008, 0.2}};
  return mean +
         deviation.cwiseProduct(VectorXd::NullaryExpr(4, [&](Eigen::Index) { return random.normal(); }));
}

/// The expected information of so many readings at 0.5 to 5 m, s = sigma f^2, and theta^ as it scatters by
/// that.
UnitSummary summary_at(const VectorXd& theta, int readings, Random& random) {
  UnitSummary unit{theta, MatrixXd::Zero(4, 4)};
  for (int i = 0; i < readings; ++i) {
    const double d = random.uniform(0.5, 5.0), f = evaluate_polynomial(VectorXd(theta.head(3)), d);
    const VectorXd mean = VectorXd{{1.0, d, d * d, 0.0}} / (std::exp(theta[3]) * f * f),
                   log_s{{2.0 / f, 2.0 * d / f, 2.0 * d * d / f, 1.0}};
    unit.information += mean * mean.transpose() + 2.0 * log_s * log_s.transpose();
  }
  const VectorXd white = VectorXd::NullaryExpr(4, [&](Eigen::Index) { return random.normal(); });
  unit.theta += unit.information.llt().matrixU().solve(white);
  return unit;
}

std::vector<UnitSummary> draw_fleet(int units, int readings, int other_readings, Random& random) {
  std::vector<UnitSummary> fleet;
  for (int u = 0; u < units; ++u)
    fleet.push_back(summary_at(draw_theta(random), u % 2 ? other_readings : readings, random));
  return fleet;
}

std::vector<UnitJudgement> judge_fleet(const std::vector<UnitSummary>& fleet) {
  const Population population = fit_population(stream_over(fleet));
  EXPECT_EQ(population.outcome, Outcome::converged) << population.reason;
  const FleetJudge judge(stream_over(fleet), population);
  std::vector<UnitJudgement> judged;
  for (const UnitSummary& unit : fleet) judged.push_back(judge(unit, judged.size()));
  return judged;
}

bool is_odd(const UnitJudgement& unit, std::size_t units) {
  return unit.p_value < alarm_rate / static_cast<double>(units);
}

/// Largest distance of the empirical distribution from the uniform one.
double distance_from_uniform(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  double distance = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i)
    distance = std::max(
        distance, std::abs(values[i] - (static_cast<double>(i) + 0.5) / static_cast<double>(values.size())));
  return distance;
}

TEST(FleetJudge, IsHotellingAndStudentOfTheOthersWhereUnitsAreExact) {
  // The others' mean m and covariance S, n of them: T^2 = (x - m)^T S^-1 (x - m) / (1 + 1/n), t_i = (x - m)_i
  // / sqrt(S_ii (1 + 1/n)). 12 units have each their own scatter, 120 share one.
  for (const std::size_t count : {12u, 120u}) {
    Random random(seed_from("FleetJudge exact", {count}));
    std::vector<UnitSummary> fleet;
    for (std::size_t u = 0; u < count; ++u)
      fleet.push_back({draw_theta(random), 1e14 * MatrixXd::Identity(4, 4)});
    fleet[3].theta[0] += offset_m / 2.0;
    const std::vector<UnitJudgement> judged = judge_fleet(fleet);
    for (const std::size_t u : {std::size_t{0}, std::size_t{3}, count - 1}) {
      const double n = static_cast<double>(count) - 1.0;
      VectorXd mean = VectorXd::Zero(4);
      for (std::size_t v = 0; v < count; ++v)
        if (v != u) mean += fleet[v].theta / n;
      MatrixXd S = MatrixXd::Zero(4, 4);
      for (std::size_t v = 0; v < count; ++v)
        if (v != u) S += (fleet[v].theta - mean) * (fleet[v].theta - mean).transpose() / (n - 1.0);
      const VectorXd e = fleet[u].theta - mean;
      const double T_sq = e.dot(S.inverse() * e) / (1.0 + 1.0 / n);
      EXPECT_NEAR(judged[u].distance_sq, T_sq, 1e-5 * T_sq);
      const VectorXd t = e.cwiseQuotient((S.diagonal() * (1.0 + 1.0 / n)).cwiseSqrt());
      EXPECT_LT((judged[u].t - t).norm(), 1e-5 * t.norm());
      const double p_all = cdf(complement(boost::math::fisher_f(unknowns, n - unknowns),
                                          T_sq * (n - unknowns) / (unknowns * (n - 1.0)))),
                   p_t = 2.0 * cdf(complement(boost::math::students_t(n - 1.0), t.cwiseAbs().maxCoeff())),
                   p_each = 1.0 - std::pow(1.0 - p_t, unknowns);
      EXPECT_NEAR(judged[u].p_value, 1.0 - std::pow(1.0 - std::min(p_all, p_each), 2.0), 1e-6);
    }
  }
}

TEST(FleetJudge, FaultlessUnitsHaveTheirShareOfEachPValue) {
  struct Case {
    int units, readings, other_readings;
  };
  // 300 readings each, and fleets of half poor, half rich units: there the laws hold from above only.
  for (const Case c : {Case{6, 300, 300},
                       {8, 300, 300},
                       {12, 300, 300},
                       {20, 300, 300},
                       {200, 300, 300},
                       {8, 60, 6000},
                       {30, 60, 6000},
                       {200, 60, 6000}}) {
    Random random(seed_from("FleetJudge faultless",
                            {static_cast<std::uint64_t>(c.units), static_cast<std::uint64_t>(c.readings)}));
    std::vector<double> of_distance, of_t, both;
    while (both.size() < 2400)
      for (const UnitJudgement& unit :
           judge_fleet(draw_fleet(c.units, c.readings, c.other_readings, random))) {
        const double n = c.units - 1.0;
        of_distance.push_back(cdf(complement(boost::math::fisher_f(unknowns, n - unknowns),
                                             unit.distance_sq * (n - unknowns) / (unknowns * (n - 1.0)))));
        of_t.push_back(cdf(boost::math::students_t(n - 1.0), unit.t[3]));
        both.push_back(unit.p_value);
      }
    const auto count = static_cast<double>(both.size());
    if (c.readings == c.other_readings) {
      // Kolmogorov's 1.95 / sqrt(N) is exceeded once in 1000; at six units the distances that readings were
      // taken at differ enough to add 0.02.
      EXPECT_LT(distance_from_uniform(of_distance), 1.95 / std::sqrt(count) + (c.units < 8 ? 0.02 : 0.0))
          << c.units;
      EXPECT_LT(distance_from_uniform(of_t), 1.95 / std::sqrt(count)) << c.units;
    }
    // The smaller of two is never below x more often than x, four binomial deviations; and not much more
    // seldom, or it would find nothing: 0.7 to 1.0 % below 0.01 in 8000 units of 300 readings, 3.3 to 4.5 %
    // below 0.05.
    for (const double x : {0.001, 0.01, 0.05, 0.5}) {
      const double below = static_cast<double>(
                       std::count_if(both.begin(), both.end(), [x](double b) { return b < x; })),
                   scatter = 4.0 * std::sqrt(count * x * (1.0 - x));
      EXPECT_LT(below, count * x + scatter) << c.units << " units, " << c.readings << " readings, " << x;
      if (c.readings == c.other_readings) {
        EXPECT_GT(below, 0.6 * count * x - scatter) << c.units << ' ' << x;
      }
    }
  }
}

Recording readings_at(const VectorXd& theta, int count, Random& random) {
  return testing::unit_readings(theta, 0.5, count, random);
}

TEST(FleetJudge, OneOddUnitOfTwelveDoesNotHideInItsOwnScatter) {
  int found = 0;
  for (std::uint64_t fleet = 0; fleet < 8; ++fleet) {
    Random random(seed_from("FleetJudge one odd", {fleet}));
    std::vector<UnitSummary> units;
    for (int u = 0; u < 12; ++u) {
      VectorXd theta = draw_theta(random);
      if (u == 11) theta[0] += offset_m;
      const Recording recording = readings_at(theta, 1000, random);
      units.push_back(*summarise(full_pairs(make_pairs_problem({&recording, 1})).calibration));
    }
    const std::vector<UnitJudgement> judged = judge_fleet(units);
    found += is_odd(judged[11], 12);
    for (std::size_t u = 0; u < 11; ++u) EXPECT_FALSE(is_odd(judged[u], 12)) << fleet << ' ' << u;
  }
  EXPECT_GE(found, 7);
}

TEST(FleetJudge, FindsOneOddUnitByTheSizeOfTheFleet) {
  // Shares found of 400 fleets of 300 readings: 8 units 30 %, 12 units 83 %, 20 units 99 %; two odd units
  // alike hide each other in 12 and 20, and are both found in 99 % of fleets of 40. Here 50 fleets each, four
  // binomial deviations.
  struct Case {
    int units, odd;
    double share;
  };
  for (const Case c : {Case{8, 1, 0.3}, {12, 1, 0.83}, {20, 1, 0.99}, {40, 2, 0.99}}) {
    Random random(seed_from("FleetJudge power", {static_cast<std::uint64_t>(c.units)}));
    int found = 0;
    for (int fleet = 0; fleet < 50; ++fleet) {
      std::vector<UnitSummary> units = draw_fleet(c.units, 300, 300, random);
      for (int u = 0; u < c.odd; ++u) units[static_cast<std::size_t>(u)].theta[0] += offset_m;
      const std::vector<UnitJudgement> judged = judge_fleet(units);
      found += std::all_of(judged.begin(), judged.begin() + c.odd,
                           [&](const UnitJudgement& unit) { return is_odd(unit, units.size()); });
    }
    EXPECT_GE(found, 50.0 * c.share - 4.0 * std::sqrt(50.0 * c.share * (1.0 - c.share))) << c.units;
  }
}

TEST(FleetJudge, TheDistanceGrowsWithTheFault) {
  Random random(seed_from("FleetJudge growth"));
  const std::vector<UnitSummary> clean = draw_fleet(12, 300, 300, random);
  double distance_sq = 0.0, p_value = 1.0;
  for (const double fault_m : {0.05, 0.1, 0.2, 0.4}) {
    std::vector<UnitSummary> fleet = clean;
    fleet[5].theta[0] += fault_m;
    const UnitJudgement odd = judge_fleet(fleet)[5];
    EXPECT_GT(odd.distance_sq, distance_sq) << fault_m;
    EXPECT_LT(odd.p_value, p_value) << fault_m;
    distance_sq = odd.distance_sq;
    p_value = odd.p_value;
  }
  // Once it is found it is left out: what the population says of the others is as if it had not been there.
  std::vector<UnitSummary> fleet = clean, without = clean;
  fleet[5].theta[0] += 0.4;
  without.erase(without.begin() + 5);
  const Population a = fit_population(stream_over(fleet)), b = fit_population(stream_over(without));
  EXPECT_EQ(a.left_out, 1);
  EXPECT_TRUE(a.outlying[5]);
  EXPECT_LT((a.covariance - b.covariance).norm(),
            0.01 * b.covariance.norm());  // EM stops at a gain of 1e-3 nats
}

TEST(FleetJudge, RefusesAnotherStreamThanThePopulations) {
  // 12 units are held one by one, 120 share one scatter: both read which units were left out.
  for (const int count : {12, 120}) {
    Random random(seed_from("FleetJudge another stream", {static_cast<std::uint64_t>(count)}));
    std::vector<UnitSummary> fleet = draw_fleet(count, 300, 300, random);
    const Population population = fit_population(stream_over(fleet));
    ASSERT_EQ(population.outcome, Outcome::converged) << population.reason;
    const FleetJudge judge(stream_over(fleet), population);
    EXPECT_NO_THROW(judge(fleet.back(), fleet.size() - 1));
    EXPECT_THROW(judge(fleet.back(), fleet.size()), InputError);
    // what a file keeps does not say which units they were
    const Population read = population_from_json(population_to_json(population), "p");
    EXPECT_THROW(FleetJudge(stream_over(fleet), read), InputError);
    const UnitSummary one_more = fleet.back();
    fleet.push_back(one_more);
    EXPECT_THROW(FleetJudge(stream_over(fleet), population), InputError);
    fleet.resize(static_cast<std::size_t>(count - 1), one_more);
    EXPECT_THROW(FleetJudge(stream_over(fleet), population), InputError);
  }
}

}  // namespace
}  // namespace rangecal
