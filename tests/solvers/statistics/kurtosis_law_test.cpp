// SPDX-License-Identifier: BSD-3-Clause
#include "statistics/kurtosis_law.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {
namespace {

double kurtosis_mean(double n) { return 3.0 * n / (n + 2.0); }
double kurtosis_deviation(double n) {
  return std::sqrt(24.0 * n * n * (n - 1.0) / ((n + 2.0) * (n + 2.0) * (n + 4.0) * (n + 6.0)));
}

struct PowerSums {
  double second = 0.0, fourth = 0.0, largest = 0.0;  ///< of z^2
};

PowerSums draw_sums(int count, Random& random) {
  PowerSums sums;
  for (int i = 0; i < count; ++i) {
    const double square = std::pow(random.normal(), 2);
    sums.second += square;
    sums.fourth += square * square;
    sums.largest = std::max(sums.largest, square);
  }
  return sums;
}

/// P(chi^2 with one degree of freedom > u).
double beyond(double u) { return std::erfc(std::sqrt(0.5 * std::max(u, 0.0))); }

/// P(n (S4 + u^2) / (S2 + u)^2 > b and u > the rest's largest) for one more square u: (n - b) u^2 - 2 b S2 u
/// + n S4 - b S2^2 > 0.
double largest_of_all_makes(double b, double n, const PowerSums& rest) {
  const double a = n - b, half = b * rest.second,
               discriminant = half * half - a * (n * rest.fourth - b * rest.second * rest.second);
  if (discriminant < 0.0) return beyond(rest.largest);
  const double high = (half + std::sqrt(discriminant)) / a, low = (half - std::sqrt(discriminant)) / a;
  return beyond(std::max(rest.largest, high)) +
         (low > rest.largest ? beyond(rest.largest) - beyond(low) : 0.0);
}

TEST(KurtosisLaw, IsNormalOnlyForValuesWithoutEnd) {
  const double n = 1e12;
  for (const double z : {-5.0, -1.0, 0.0, 2.0, 6.0})
    EXPECT_NEAR(kurtosis_score(kurtosis_mean(n) + z * kurtosis_deviation(n), n), z, 1e-2);
  // 3.9 standard deviations of 100 values are exceeded by 43 in 10 000: a score of 2.6
  EXPECT_NEAR(kurtosis_score(kurtosis_mean(100.0) + 3.9 * kurtosis_deviation(100.0), 100.0), 2.63, 0.05);
  EXPECT_EQ(kurtosis_score(100.0, 19.0), 0.0);
}

TEST(KurtosisLaw, GrowsWithTheKurtosisAndChangesLittleWithTheCount) {
  for (double n = 20.0; n < 1e6; n *= 1.21) {
    double before = -1e300;
    for (double b = 1.0; b < std::min(n, 100.0); b *= 1.05) {
      const double score = kurtosis_score(b, n);
      EXPECT_GT(score, before) << n << ' ' << b;
      before = score;
    }
    for (const double x : {-1.5, 0.0, 3.0, 8.0}) {
      const double here = kurtosis_score(kurtosis_mean(n) + x * kurtosis_deviation(n), n);
      const double next = kurtosis_score(kurtosis_mean(n + 1.0) + x * kurtosis_deviation(n + 1.0), n + 1.0);
      EXPECT_NEAR(here, next, 0.05) << n << ' ' << x;
    }
  }
}

TEST(KurtosisLaw, AnscombeAndGlynnAsSciPyHasThem) {
  // scipy.stats.kurtosistest(list(range(20))) of SciPy's reference: statistic -1.7058104152122062. The kurtosis of
  // 0 ... n - 1 is 3/5 (3 n^2 - 7) / (n^2 - 1), which is 0.6 * 1193 / 399.
  EXPECT_NEAR(anscombe_glynn(0.6 * 1193.0 / 399.0, 20.0), -1.7058104152122062, 1e-12);
}

TEST(KurtosisLaw, LightTailsAreFarBelowZero) {
  // Two values +-1 have b = 1. Anscombe and Glynn's cube root has its pole at 1.38, 1.51 and 1.63: +28 and -15 at
  // 1.0 and 1.5 of 100 values, +85 at 1.5 of 1000. Here less than the table's end, and less with more values.
  double before[] = {0.0, 0.0, 0.0};
  for (const double n : {100.0, 200.0, 1000.0}) {
    const double least = kurtosis_score(1.0, n), middle = kurtosis_score(1.2, n),
                 highest = kurtosis_score(1.5, n);
    EXPECT_LT(highest, -6.5) << n;
    EXPECT_LT(middle, highest - 1.0) << n;
    EXPECT_LT(least, middle - 1.0) << n;
    EXPECT_GT(least, -30.0) << n;
    const double now[] = {least, middle, highest};
    for (int i = 0; i < 3; ++i) {
      EXPECT_LT(now[i], before[i]) << n;
      before[i] = now[i];
    }
  }
}

TEST(KurtosisLaw, HasNoJumpWhereTheTableEnds) {
  for (const double n : {20.0, 41.0, 100.0, 700.0, 5000.0, 1e6}) {
    double low = kurtosis_mean(n), high = std::min(n, 100.0);  // the score is 6.5 between them
    for (int step = 0; step < 80; ++step)
      (kurtosis_score(0.5 * (low + high), n) < 6.5 ? low : high) = 0.5 * (low + high);
    EXPECT_NEAR(kurtosis_score(low, n), 6.5, 1e-9) << n;
    EXPECT_NEAR(kurtosis_score(high, n), 6.5, 1e-9) << n;
  }
}

/// Nats that a contaminated normal gains on a normal, by EM.
double gain_of_tails(const std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  double square = 0.0;
  for (const double v : values) square += v * v / n;
  double s = std::sqrt(square) / 1.3, p = 0.05, k = 5.0, value = 0.0;
  for (int round = 0; round < 300; ++round) {
    double share = 0.0, body = 0.0, wide = 0.0;
    value = -n * std::log(s);
    for (const double v : values) {
      const ContaminatedDensity at = contaminated_density(p, k, v / s);
      value += at.log_density;
      share += at.outlier;
      body += (1.0 - at.outlier) * v * v;
      wide += at.outlier * v * v;
    }
    s = std::sqrt(body / (n - share));
    k = std::sqrt(wide / share) / s;
    p = share / n;
  }
  return value + 0.5 * n * (std::log(square) + 1.0);
}

TEST(KurtosisLaw, BeyondTheTableItSaysWhatHeavyTailsAreWorth) {
  // About half; a quarter to one holds what the draws scatter. The straight line says 100 times as much at 20 000
  // values, the probability a tenth.
  struct Case {
    int n;
    double share, ratio;
  };
  for (const Case c : {Case{1000, 0.03, 6.0}, {1000, 0.1, 3.0}, {4000, 0.05, 5.0}, {20000, 0.03, 6.0}}) {
    Random random(seed_from("KurtosisLaw worth", {static_cast<std::uint64_t>(c.n)}));
    std::vector<double> values;
    double second = 0.0, fourth = 0.0;
    for (int i = 0; i < c.n; ++i) {
      const bool far = random.uniform() < c.share;
      values.push_back(random.normal() * (far ? c.ratio : 1.0));
      second += std::pow(values.back(), 2);
      fourth += std::pow(values.back(), 4);
    }
    const double score = kurtosis_score(c.n * fourth / (second * second), c.n);
    const double worth = 0.5 * score * score / gain_of_tails(values);
    EXPECT_GT(score, 6.5) << c.n;
    EXPECT_GT(worth, 0.25) << c.n << ' ' << c.share;
    EXPECT_LT(worth, 1.0) << c.n << ' ' << c.share;
  }
}

TEST(KurtosisLaw, HoldsInTheBody) {
  // Shares beyond scores of 1.645 and 2.326, each side: 0.05 and 0.01; four binomial deviations and 5 % for
  // the table.
  for (const int n : {26, 37, 80, 400, 2000}) {
    Random random(seed_from("KurtosisLaw body", {static_cast<std::uint64_t>(n)}));
    const int draws = n > 1000 ? 4000 : 20000;
    int beyond_score[2][2] = {};
    for (int i = 0; i < draws; ++i) {
      const PowerSums sums = draw_sums(n, random);
      const double score = kurtosis_score(n * sums.fourth / (sums.second * sums.second), n);
      for (const int strict : {0, 1})
        if (std::abs(score) > (strict ? 2.3263 : 1.6449)) ++beyond_score[strict][score > 0.0];
    }
    for (const int strict : {0, 1})
      for (const int side : {0, 1}) {
        const double p = strict ? 0.01 : 0.05, expected = p * draws;
        EXPECT_NEAR(beyond_score[strict][side], expected,
                    4.0 * std::sqrt(expected * (1.0 - p)) + 0.05 * expected)
            << n << ' ' << strict << ' ' << side;
      }
  }
}

TEST(KurtosisLaw, HoldsInTheFarUpperTail) {
  // n P of the largest square making the kurtosis, given the others (Asmussen and Kroese 2006): its
  // estimate's own scatter is the tolerance, four deviations, and 0.05 in the score for the table. Of few
  // values the others alone make most of what lies beyond a score of 5, which takes too many draws.
  struct Case {
    int n, draws, highest;
  };
  for (const Case c : {Case{37, 200000, 4}, {80, 200000, 5}, {400, 60000, 5}}) {
    Random random(seed_from("KurtosisLaw tail", {static_cast<std::uint64_t>(c.n)}));
    const int scores = c.highest - 2;
    double sum[3] = {}, squares[3] = {}, at[3] = {};
    for (int k = 0; k < scores; ++k) {  // the kurtosis of score 3, 4, 5, by bisection
      double low = 1.0, high = c.n;
      for (int step = 0; step < 60; ++step)
        (kurtosis_score(0.5 * (low + high), c.n) < 3.0 + k ? low : high) = 0.5 * (low + high);
      at[k] = low;
    }
    for (int i = 0; i < c.draws; ++i) {
      const PowerSums rest = draw_sums(c.n - 1, random);
      for (int k = 0; k < scores; ++k) {
        const double p = c.n * largest_of_all_makes(at[k], c.n, rest);
        sum[k] += p / c.draws;
        squares[k] += p * p / c.draws;
      }
    }
    for (int k = 0; k < scores; ++k) {
      const double relative = std::sqrt((squares[k] / (sum[k] * sum[k]) - 1.0) / c.draws);
      EXPECT_LT(relative, 0.1) << c.n << ' ' << k;
      // d log p / d score is score + 1 / score at least
      EXPECT_NEAR(normal_upper_quantile(sum[k]), 3.0 + k, 0.05 + 4.0 * relative / (3.0 + k)) << c.n;
    }
  }
}

}  // namespace
}  // namespace rangecal
