// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/tail_law.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "rangecal/core/distributions.hpp"
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal {
namespace {

constexpr double s = 0.01;  // [m]

struct TailLaws {
  std::string name;
  std::vector<Contamination> parts;
};

const std::vector<TailLaws>& tail_laws() {
  static const std::vector<TailLaws> all{
      {"even", {{.share = 0.03, .extra_sigma_m = 0.05}}},
      {"late", {{.share = 0.05, .mean_m = 0.3}}},
      {"early, ends", {{.share = 0.08, .mean_m = -0.2, .end_m = 0.5}}},
      {"early, evenly", {{.share = 0.1, .mean_m = -20.0, .end_m = 0.4}}},
      {"shorter than the spread", {{.share = 0.2, .mean_m = 0.002, .end_m = 0.004}}},
      {"several",
       {{.share = 0.03, .extra_sigma_m = 0.05},
        {.share = 0.05, .mean_m = 0.1},
        {.share = 0.05, .mean_m = -0.3, .end_m = 0.6}}}};
  return all;
}

TailLaw law_of(const TailLaws& laws) {
  TailLaw law;
  for (const Contamination& part : laws.parts) law.add(part);
  return law;
}

/// Mean of the extra errors of all readings, by the formula: of an exponential of mean tau that ends at L it is
/// tau - L / (exp(L / tau) - 1). Shares p_k have weights p_k / (1 - p_k) beside 1 of the body.
double mean_of(const TailLaws& laws) {
  double mean = 0.0, odds = 1.0;
  for (const Contamination& part : laws.parts) {
    const double own = part.share / (1.0 - part.share), tau = std::abs(part.mean_m);
    odds += own;
    if (tau == 0.0) continue;
    const double lost = std::isfinite(part.end_m) ? part.end_m / std::expm1(part.end_m / tau) : 0.0;
    mean += own * std::copysign(tau - lost, part.mean_m);
  }
  return mean / odds;
}

/// Integral of f over the errors that any of these laws has, by the midpoint rule in steps of some fortieth of s.
template <typename F>
double integral(const F& f, double from = -1.5, double to = 6.0) {
  const auto steps = static_cast<int>(std::ceil((to - from) / (s / 40.0)));
  const double step = (to - from) / steps;
  double sum = 0.0;
  for (int i = 0; i < steps; ++i) sum += step * f(from + (i + 0.5) * step);
  return sum;
}

TEST(TailLaw, DensitiesIntegrateToOneAndToTheMeans) {
  for (const TailLaws& each : tail_laws()) {
    const TailLaw law = law_of(each);
    const auto density = [&](double e) { return std::exp(law.density(e, s).value) / s; };
    EXPECT_NEAR(integral(density), 1.0, 1e-8) << each.name;
    EXPECT_NEAR(integral([&](double e) { return e * density(e); }), mean_of(each), 1e-7) << each.name;
  }
}

TEST(TailLaw, IsTheConvolutionByDefinition) {
  // x of density exp(-x / tau) / tau / (1 - exp(-L / tau)) on 0 .. L, and s N(0, 1): by quadrature over x.
  for (const double tau : {0.004, 0.05, 0.3, 50.0})
    for (const double end : {0.006, 0.2}) {
      TailLaw law;
      law.add({.share = 0.3, .mean_m = -tau, .end_m = end});
      for (const double e : {-0.23, -0.19, -0.03, 0.0, 0.015}) {
        constexpr int steps = 40000;
        double tail = 0.0;
        for (int i = 0; i < steps; ++i) {
          const double x = (i + 0.5) * end / steps, z = (e + x) / s;
          tail += end / steps * std::exp(-x / tau) / tau / -std::expm1(-end / tau) * std::exp(-0.5 * z * z);
        }
        const double z = e / s, expected = 0.7 * std::exp(-0.5 * z * z) + 0.3 * tail;
        if (expected < 1e-250) continue;
        EXPECT_NEAR(law.density(e, s).value, std::log(expected) - 0.9189385332046727, 1e-6)
            << tau << ' ' << end << ' ' << e;
      }
    }
}

TEST(TailLaw, SlopesAndTheGaussianThatStandsForIt) {
  constexpr double h = 1e-6;  // of z: third derivatives of order 1e3 give 1e-9
  for (const TailLaws& each : tail_laws()) {
    const TailLaw law = law_of(each);
    for (const double z : {-35.0, -6.0, -2.0, 0.0, 1.0, 3.5, 30.0}) {
      const LogDensity at = law.density(z * s, s);
      const double slope =
          (law.density((z + h) * s, s).value - law.density((z - h) * s, s).value) / (2.0 * h);
      EXPECT_NEAR(at.derivative, slope, 1e-6 * (1.0 + std::abs(slope))) << each.name << ' ' << z;
      EXPECT_NEAR(at.derivative, -at.weight * (z - at.shift), 1e-9 * (1.0 + std::abs(z)))
          << each.name << ' ' << z;
      // d / d ln s of the log density is weight (z - shift)^2 + extra: that the calibration of s sees the law itself.
      const double in_log_s =
          (law.density(z * s, s * (1.0 + h)).value - law.density(z * s, s * (1.0 - h)).value) / (2.0 * h);
      // extra errors are fixed in metres, but for the even share, whose ratio to s moves by its own derivative
      if (each.parts.front().extra_sigma_m > 0.0) continue;
      const double off = z - at.shift;
      // density() is of z; that of e has another 1 / s
      EXPECT_NEAR(at.weight * off * off + at.extra_square - 1.0, in_log_s - 1.0,
                  2e-5 * (1.0 + std::abs(in_log_s)))
          << each.name << ' ' << z;
    }
  }
}

TEST(TailLaw, CurvatureIsThatOfTheLogDensity) {
  constexpr double h = 1e-5;  // of z
  for (const TailLaws& each : tail_laws()) {
    const TailLaw law = law_of(each);
    for (const double z : {-35.0, -6.0, -2.0, 0.0, 1.0, 2.4, 3.5, 30.0}) {
      TailLaw::Slopes slopes;
      law.density(z * s, s, &slopes);
      const double second =
          (law.density((z + h) * s, s).derivative - law.density((z - h) * s, s).derivative) / (2.0 * h);
      EXPECT_NEAR(slopes.curvature, -second, 1e-5 * (1.0 + std::abs(second))) << each.name << ' ' << z;
    }
  }
  TailLaw::Slopes slopes;
  TailLaw().density(2.0 * s, s, &slopes);
  EXPECT_NEAR(slopes.curvature, 1.0, 1e-12);
}

TEST(TailLaw, SlopesInSharesAndSizes) {
  constexpr double h = 1e-5;  // of each, relatively
  for (const TailLaws& each : tail_laws())
    for (const double z : {-35.0, -6.0, -2.0, 0.0, 1.0, 3.5, 30.0}) {
      TailLaw::Slopes slopes;
      law_of(each).density(z * s, s, &slopes);
      for (std::size_t k = 0; k < each.parts.size(); ++k) {
        const auto slope = [&](double Contamination::*member) {
          TailLaws up = each, down = each;
          const double step = h * each.parts[k].*member;
          up.parts[k].*member += step;
          down.parts[k].*member -= step;
          return (law_of(up).density(z * s, s).value - law_of(down).density(z * s, s).value) / (2.0 * step);
        };
        const double in_share = slope(&Contamination::share);
        EXPECT_NEAR(slopes.in_share[k], in_share, 1e-6 * (1.0 + std::abs(in_share))) << each.name << ' ' << z;
        const double in_size =
            slope(each.parts[k].mean_m != 0.0 ? &Contamination::mean_m : &Contamination::extra_sigma_m);
        EXPECT_NEAR(slopes.in_size[k], in_size, 1e-5 * (1.0 + std::abs(in_size))) << each.name << ' ' << z;
      }
    }
}

TEST(TailLaw, ScoresAreNormal) {
  for (const TailLaws& each : tail_laws()) {
    const TailLaw law = law_of(each);
    const auto density = [&](double e) { return std::exp(law.density(e, s).value) / s; };
    for (const double e : {-0.3, -0.02, 0.0, 0.005, 0.03, 0.4}) {
      const double below = integral(density, -1.5, e);
      if (below < 1e-6 || below > 1.0 - 1e-6) continue;
      EXPECT_NEAR(normal_below(law.normal_score(e, s)), below, 2e-4) << each.name << ' ' << e;
    }
  }
}

TEST(TailLaw, DrawsFollowIt) {
  constexpr int count = 40000;
  for (const TailLaws& each : tail_laws()) {
    const TailLaw law = law_of(each);
    Random random(seed_from("TailLaw.DrawsFollowIt." + each.name, {1}));
    double sum = 0.0, square = 0.0;
    for (int i = 0; i < count; ++i) {
      const double score = law.normal_score(s * random.normal() + law.draw(random), s);
      sum += score, square += score * score;
    }
    // mean 0 +- 1 / sqrt n, mean square 1 +- sqrt(2 / n): five standard errors
    EXPECT_NEAR(sum / count, 0.0, 5.0 / std::sqrt(count)) << each.name;
    EXPECT_NEAR(square / count, 1.0, 5.0 * std::sqrt(2.0 / count)) << each.name;
  }
}

TEST(TailLaw, NegentropyIsWhatTheNormalLawLoses) {
  for (const TailLaws& each : tail_laws()) {
    const TailLaw law = law_of(each);
    const auto density = [&](double e) { return std::exp(law.density(e, s).value) / s; };
    const double mean = mean_of(each),
                 variance = integral([&](double e) { return (e - mean) * (e - mean) * density(e); });
    const double lost = integral([&](double e) {
      const double p = density(e), off = e - mean;
      if (p < 1e-290) return 0.0;
      return p * (std::log(p) + 0.5 * std::log(2.0 * M_PI * variance) + 0.5 * off * off / variance);
    });
    EXPECT_NEAR(law.negentropy(s), 2.0 * lost, 1e-3 * (1.0 + 2.0 * lost)) << each.name;
  }
}

TEST(TailLaw, OfNothingIsNormalAndOfOneShareItsOwn) {
  TailLaw none;
  none.add({});
  EXPECT_TRUE(none.empty());
  EXPECT_NEAR(none.density(0.02, s).value, -0.9189385332046727 - 2.0, 1e-14);
  EXPECT_NEAR(none.normal_score(-0.03, s), -3.0, 1e-9);
  TailLaw one;
  one.add({.share = 0.03, .extra_sigma_m = s * std::sqrt(24.0)});
  const ContaminatedDensity same = contaminated_density(0.03, 5.0, 4.0);
  EXPECT_NEAR(one.density(4.0 * s, s).value, same.log_density - 0.9189385332046727, 1e-13);
  EXPECT_NEAR(one.density(4.0 * s, s).weight, same.weight, 1e-13);
}

TEST(OneSidedEffects, EndWhereTheirPhysicsDoes) {
  ReadingView<double> at{};
  at.f = 1.2;
  const double p[] = {0.05, 0.4};
  const Contamination early = find_effect("early_echo")->contamination(at, p);
  EXPECT_EQ(early.share, 0.05);
  EXPECT_EQ(early.mean_m, -0.4);
  EXPECT_EQ(early.end_m, 1.2);  // nothing is read behind the sensor
  const Contamination late = find_effect("late_return")->contamination(at, p);
  EXPECT_EQ(late.mean_m, 0.4);
  EXPECT_FALSE(std::isfinite(late.end_m));
}

TEST(TailLaw, ItsMeanIsThatOfDraws) {
  TailLaw law;
  EXPECT_EQ(law.mean(), 0.0);
  law.add({.share = 0.2, .mean_m = -0.3, .end_m = 0.5});
  // By hand: -0.2 (0.3 - 0.5 / (e^(5/3) - 1)) = -0.2 (0.3 - 0.1165) = -0.0367.
  EXPECT_NEAR(law.mean(), -0.0367, 1e-4);
  law.add({.share = 0.1, .mean_m = 0.4});
  law.add({.share = 0.1, .extra_sigma_m = 1.0});
  Random random(seed_from("TailLaw.Mean"));
  constexpr int draws = 400000;  // of a standard deviation of 0.4 m: 0.6 mm
  double sum = 0.0;
  for (int i = 0; i < draws; ++i) sum += law.draw(random) / draws;
  EXPECT_NEAR(law.mean(), sum, 0.0025);
}

}  // namespace
}  // namespace rangecal
