// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/posterior.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "support/calibration_of.hpp"

namespace rangecal {
namespace {

using testing::calibration_of;

/// f = 2 d - 0.25 d^2 turns at d = 4: readings above f(0.5) have two roots up to 7.5.
Calibration turning(double sigma = 0.03) {
  return calibration_of(Eigen::Vector3d(0.0, 2.0, -0.25), NoiseLaw::constant, sigma, 0.5, 7.0);
}

TEST(Posterior, OfALineIsTheNormalHandWorked) {
  // f = 0.1 + 0.5 d, s = 0.01, y = 1.1: N(2, 0.02^2); interval 2 -+ 1.959964 * 0.02. The prior N(2.03, 0.01^2) alone has
  // precision 1e4, the reading 2500: mean (2 * 2500 + 2.03 * 1e4) / 12500 = 2.024, std 1 / sqrt(12500) = 0.00894427.
  const Calibration c = calibration_of(Eigen::Vector2d(0.1, 0.5), NoiseLaw::constant, 0.01, 0.5, 4.0);
  const EffectCorrector corrector(c, {});
  const DistancePosterior flat = distance_posterior(corrector, 1.1, {});
  EXPECT_NEAR(flat.mean_m, 2.0, 1e-8);
  EXPECT_NEAR(flat.mode_m, 2.0, 1e-7);
  EXPECT_NEAR(flat.std_dev_m, 0.02, 1e-8);
  EXPECT_NEAR(flat.low_m, 2.0 - 1.959964 * 0.02, 1e-7);
  EXPECT_NEAR(flat.high_m, 2.0 + 1.959964 * 0.02, 1e-7);
  ASSERT_EQ(flat.roots.size(), 1u);
  EXPECT_NEAR(flat.roots[0].probability, 1.0, 1e-12);
  EXPECT_NEAR(flat.log_evidence, std::log(1.0 / 3.5 / 0.5),
              1e-8);  // integral of N over d is 1 / f', times 1 / (4 - 0.5)
  DistancePrior map;
  map.components = {{1.0, 2.03, 0.01, 0.0}};
  map.surprise = 0.0;
  const DistancePosterior told = distance_posterior(corrector, 1.1, {}, map);
  EXPECT_NEAR(told.mean_m, 2.024, 1e-8);
  EXPECT_NEAR(told.std_dev_m, 0.00894427, 1e-8);
}

TEST(Posterior, UncertaintyOfTheCurveAndEffectsCount) {
  // f = alpha_0 + d with cov(alpha_0) = 0.03^2 and s = 0.04: std 0.05
  Calibration c = calibration_of(Eigen::Vector2d(0.0, 1.0), NoiseLaw::constant, 0.04, 0.5, 4.0);
  c.alpha_covariance = Eigen::Matrix2d::Zero();
  (*c.alpha_covariance)(0, 0) = 0.0009;
  EXPECT_NEAR(distance_posterior(EffectCorrector(c, {}), 2.0, {}).std_dev_m, 0.05, 1e-7);
  c.effects["range_offset"]["offset_m"] = 0.1;
  EXPECT_NEAR(distance_posterior(EffectCorrector(c, {}), 2.0, {}).mean_m, 1.9, 1e-7);
}

TEST(Posterior, IntegralsMatchABruteForceSum) {
  for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f_squared, NoiseLaw::d_squared}) {
    Calibration c = turning();
    c.noise.law = law;
    c.noise.parameters[0] = law == NoiseLaw::constant ? 0.03 : 0.004;
    const EffectCorrector corrector(c, {});
    for (const double y : {1.0, 3.0, 3.9, 3.999, 4.05}) {
      const DistancePosterior posterior = distance_posterior(corrector, y, {});
      double mass = 0, first = 0, near = 0, below = 0;  // midpoints of 2 million cells
      constexpr int cells = 2000000;
      for (int i = 0; i < cells; ++i) {
        const double d = 0.5 + 6.5 * (i + 0.5) / cells, f = evaluate_polynomial(c.alpha, d),
                     s = c.noise.spread(d, f);
        const double w = std::exp(-0.5 * std::pow((y - f) / s, 2)) / s;
        mass += w;
        first += w * d;
        if (d < 4.0) near += w;
        if (d < posterior.low_m) below += w;
      }
      EXPECT_NEAR(posterior.mean_m, first / mass, 1e-6);
      EXPECT_NEAR(posterior.roots[0].probability, near / mass, 1e-6);
      EXPECT_NEAR(below / mass, 0.025, 1e-4);  // one cell of the sum is up to 1e-5 of the mass
      EXPECT_NEAR(posterior.roots[0].probability + posterior.roots[1].probability, 1.0, 1e-12);
    }
  }
}

TEST(Posterior, OfAReadingBeyondTheEndIsATailAtTheEnd) {
  // f = 0.05 + 0.95 d, s = 0.001, range from 0.3: f(0.3) = 0.335, and y = 0.333 lies 2 sd below. The distance is the normal of
  // mean 0.283/0.95 = 0.2978947 and sd s/0.95 = 0.0010526 cut off at 0.3, a = 2: mean = m + sd h, var = sd^2 (1 + a h - h^2) with
  // h = phi(2)/Q(2) = 2.373216; 2.5 and 97.5 % at 1 - Q(2) 0.975, 0.025: z = 2.0103 and 3.2542.
  const Calibration c = calibration_of(Eigen::Vector2d(0.05, 0.95), NoiseLaw::constant, 0.001, 0.3, 6.0);
  const DistancePosterior low = distance_posterior(EffectCorrector(c, {}), 0.333, {});
  const double sd = 0.001 / 0.95, m = 0.283 / 0.95, h = 2.3732155;
  EXPECT_NEAR(low.mean_m, m + sd * h, 1e-8);
  EXPECT_NEAR(low.std_dev_m, sd * std::sqrt(1.0 + 2.0 * h - h * h), 1e-7);
  EXPECT_NEAR(low.low_m, 0.300011, 2e-6);
  EXPECT_NEAR(low.high_m, 0.301320, 2e-6);
  // and its image at the other end
  const Calibration back =
      calibration_of(Eigen::Vector2d(0.05 + 0.95 * 6.3, -0.95), NoiseLaw::constant, 0.001, 0.3, 6.0);
  const DistancePosterior high = distance_posterior(EffectCorrector(back, {}), 0.333, {});
  EXPECT_NEAR(high.mean_m, 6.3 - low.mean_m, 1e-8);
  EXPECT_NEAR(high.std_dev_m, low.std_dev_m, 1e-8);
}

TEST(Posterior, StatesWhatHappensAsOftenAsItHappens) {
  // Distances from the prior, readings from the model: binomial limits, 4 standard deviations.
  const Calibration c = turning();
  const EffectCorrector corrector(c, {});
  DistancePrior map;
  map.components = {{0.5, 3.0, 0.4, 0.0}, {0.5, 5.5, 0.3, 0.5}};
  map.surprise = 0.0;
  map.low_m = 0.5;
  map.high_m = 7.0;
  for (const bool informed : {false, true}) {
    constexpr int count = 4000;
    Random random(seed_from("posterior coverage", {informed ? 1u : 0u}));
    int held = 0;
    double stated = 0.0, variance = 0.0;
    int near = 0;
    for (int i = 0; i < count; ++i) {
      double d = random.uniform(0.5, 7.0);
      while (informed) {
        d = random.uniform() < 0.5 ? random.normal(3.0, 0.4)
                                   : random.normal(5.5, 0.3) + random.uniform(-0.5, 0.5);
        if (d > 0.5 && d < 7.0) break;
      }
      const double y = random.normal(evaluate_polynomial(c.alpha, d), 0.03);
      if (!(y > 0.0)) continue;
      const DistancePosterior posterior =
          distance_posterior(corrector, y, {}, informed ? map : DistancePrior{});
      held += posterior.low_m <= d && d <= posterior.high_m;
      const double p = posterior.roots[0].probability;
      stated += p;
      variance += p * (1.0 - p);
      near += d < 4.0;
    }
    EXPECT_NEAR(held / double(count), 0.95, 4.0 * std::sqrt(0.95 * 0.05 / count)) << informed;
    EXPECT_NEAR(near, stated, 4.0 * std::sqrt(variance)) << informed;
  }
}

TEST(Posterior, MotionTellsTheRootsApart) {
  // From 0.6 m, whose mirror image 7.4 m the prior excludes, outwards to 3.5 m, 2 cm a reading: from 1 m on each reading alone
  // could as well stand for 8 m - d.
  const Calibration c = turning();
  const EffectCorrector corrector(c, {});
  Random random(seed_from("posterior motion"));
  DistancePrior prior;
  int alone_right = 0, right = 0, held = 0, count = 0;
  DistancePosterior posterior;
  for (double d = 0.6; d < 3.5; d += 0.02, ++count) {
    const double y = random.normal(evaluate_polynomial(c.alpha, d), 0.03);
    const DistancePosterior alone = distance_posterior(corrector, y, {});
    alone_right += alone.roots[0].probability > 0.9;
    posterior = distance_posterior(corrector, y, {}, prior);
    right += posterior.roots[0].probability > 0.9;
    held += posterior.low_m <= d && d <= posterior.high_m;
    prior = moved(posterior, {}, 0.05);
  }
  EXPECT_LT(alone_right, 0.3 * count);
  EXPECT_EQ(right, count);
  EXPECT_GT(held, 0.85 * count);  // 145 correlated readings at 95 %: 4 standard deviations are 7 % and more
  EXPECT_THROW(moved(posterior, {}, -1.0), InputError);
}

TEST(Posterior, AWrongPredictionIsLeft) {
  const Calibration c = calibration_of(Eigen::Vector2d(0.0, 1.0), NoiseLaw::constant, 0.01, 0.5, 5.0);
  DistancePrior map;
  map.components = {{1.0, 1.0, 0.01, 0.0}};
  const DistancePosterior posterior = distance_posterior(EffectCorrector(c, {}), 4.0, {}, map);
  EXPECT_NEAR(posterior.mean_m, 4.0, 1e-3);
}

TEST(Posterior, DegenerateAndHostile) {
  const Calibration c = turning();
  const EffectCorrector corrector(c, {});
  const DistancePosterior beyond = distance_posterior(corrector, 9.0, {});  // 170 s above what f reaches
  EXPECT_EQ(beyond.outcome, Outcome::failed);
  EXPECT_NE(beyond.reason.find("standard deviations off at every distance"), std::string::npos)
      << beyond.reason;
  EXPECT_TRUE(std::isnan(PosteriorTable(c, {}, 64)(9.0).mean_m));
  for (const double bad : {0.0, -1.0, std::nan(""), HUGE_VAL})
    EXPECT_THROW(distance_posterior(corrector, bad, {}), InputError);
  DistancePrior prior;
  prior.low_m = 3.0;
  prior.high_m = 2.0;
  EXPECT_THROW(distance_posterior(corrector, 1.0, {}, prior), InputError);
  prior = {};
  prior.components = {{1.0, 2.0, 0.0, 0.0}};
  EXPECT_THROW(distance_posterior(corrector, 1.0, {}, prior), InputError);
}

TEST(Posterior, AReadingThatNoDistanceExplainsHasNone) {
  // Noise that grows with the distance makes a reading below all that the sensor reads least unlikely at the far end.
  const Calibration c =
      calibration_of(Eigen::Vector2d(0.0, 1.0), NoiseLaw::f_squared, 0.002, 0.5, 5.0);  // s(0.5 m) = 0.5 mm
  const EffectCorrector corrector(c, {});
  EXPECT_EQ(distance_posterior(corrector, 0.4985, {}).outcome, Outcome::converged);  // 3 s
  EXPECT_LT(distance_posterior(corrector, 0.4985, {}).high_m, 0.51);
  EXPECT_EQ(distance_posterior(corrector, 0.4975, {}).outcome, Outcome::failed);  // 5 s
  EXPECT_EQ(distance_posterior(corrector, 0.45, {}).outcome, Outcome::failed);    // 100 s there, 91 s at 5 m
  DistancePrior map;
  map.components = {{1.0, 0.45, 0.05, 0.0}};
  EXPECT_EQ(distance_posterior(corrector, 0.45, {}, map).outcome, Outcome::failed);
}

TEST(PosteriorTable, SaysWhatTheIntegralsSay) {
  for (const double sigma : {0.002, 0.03}) {
    const Calibration c = turning(sigma);
    const PosteriorTable table(c, {}, 2048);
    const EffectCorrector corrector(c, {});
    EXPECT_EQ(table.root_count(), 2);
    EXPECT_LT(table.exact_share(), 0.5);
    Random random(seed_from("posterior table"));
    for (int i = 0; i < 300; ++i) {
      const double y = random.uniform(0.5, 4.3);
      const PosteriorTable::Row row = table(y);
      const DistancePosterior exact = distance_posterior(corrector, y, {});
      if (exact.outcome != Outcome::converged) {  // below what the sensor reads at the near end
        EXPECT_TRUE(std::isnan(row.mean_m)) << y;
        continue;
      }
      const double width =
          2e-3 * exact.std_dev_m;  // the midpoint holds 1e-3; elsewhere in a cell little more
      EXPECT_NEAR(row.mean_m, exact.mean_m, width) << y;
      EXPECT_NEAR(row.mode_m, exact.mode_m, width) << y;
      EXPECT_NEAR(row.low_m, exact.low_m, width) << y;
      EXPECT_NEAR(row.high_m, exact.high_m, width) << y;
      EXPECT_NEAR(row.probability[0], exact.roots[0].probability, 2e-3) << y;
    }
    EXPECT_TRUE(std::isnan(table(-1.0).mean_m));
    EXPECT_TRUE(std::isnan(table(std::nan("")).mode_m));
  }
}

}  // namespace
}  // namespace rangecal
