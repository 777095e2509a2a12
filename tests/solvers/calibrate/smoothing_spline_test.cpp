// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/smoothing_spline.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "calibrate/scale_choice.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/correction/correct.hpp"
#include "support/pairs_of.hpp"

namespace rangecal {
namespace {

const std::vector<double> bent_y{0.0520, 0.2529, 0.4570, 0.6661, 0.8819, 1.1140, 1.3763, 1.6284,
                                 1.8825, 2.1493, 2.3397, 2.6046, 2.8081, 2.9585, 3.2175, 3.3688,
                                 3.5085, 3.7340, 3.9497, 4.2132, 4.4092, 4.6046, 4.8605, 4.8221};

std::vector<double> fifths() {
  std::vector<double> d;
  for (int i = 1; i <= 24; ++i) d.push_back(i / 5.0);
  return d;
}

using testing::pairs_of;

CalibrateOptions options_of(std::optional<CurveFamily> curve, NoiseLaw law) {
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.curve = curve;
  options.noise = law;
  options.noise_shape = NoiseShape::gaussian;
  return options;
}

struct OfR {
  double fit[5], std_dev[5], degrees;  // at 0.2, 0.7, 1.55, 3.1 and 4.8 m
};

// R 4.2.2, mgcv 1.8-41: gam(y ~ s(d, bs = "cr", k = 24), knots = list(d = d), weights = w / mean(w), method = "REML"), with the
// tolerances 1e-12; predict(..., se.fit = TRUE), sum(edf).
const OfR of_equal_weights{
    {0.0489933744273, 0.5601298826701, 1.5647827391178, 3.2710935111908, 4.8897349974678},
    {0.03008396721, 0.02041928870, 0.02009251339, 0.01999338049, 0.03008396721},
    8.876706463};
const OfR of_fourth_power{
    {0.0519996253876, 0.5607220731374, 1.5650818372768, 3.2786450515117, 4.9599346517164},
    {0.0001523689888, 0.0015682945221, 0.0060477334769, 0.0173265754291, 0.0553001216056},
    9.969830473};

void expect_as_r(const SmoothingSpline& spline, const OfR& r) {
  const CurveScale& scale = spline.scale;
  EXPECT_NEAR(scale.spline->degrees, r.degrees, 2e-4);
  const double at[5] = {0.2, 0.7, 1.55, 3.1, 4.8};
  for (int i = 0; i < 5; ++i)
    EXPECT_NEAR(spline.level + spline.factor * scale.of(at[i]), r.fit[i], 1e-5) << at[i];
  for (int i = 0; i < 5; ++i)
    EXPECT_NEAR(scale.of(at[i]) - scale.of(at[0]), 4.6 * (r.fit[i] - r.fit[0]) / (r.fit[4] - r.fit[0]), 2e-6)
        << at[i];
  EXPECT_NEAR(scale.of(0.0), 0.0, 1e-15);
}

TEST(SmoothingSpline, AgreesWithMgcv) {
  const std::vector<double> d = fifths();
  const auto equal = smoothing_spline(d, bent_y);
  ASSERT_TRUE(equal);
  EXPECT_FALSE(equal->stiffened);
  expect_as_r(*equal, of_equal_weights);
  std::vector<double> weights;
  for (const double x : d) weights.push_back(std::pow(x, -4));
  const auto fourth = smoothing_spline(d, bent_y, weights);
  ASSERT_TRUE(fourth);
  expect_as_r(*fourth, of_fourth_power);
}

TEST(SmoothingSpline, CalibrationHasItsCurveAndDeviations) {
  const Recording recording = pairs_of(fifths(), bent_y);
  const Calibration c =
      calibrate({&recording, 1}, options_of(CurveFamily::spline, NoiseLaw::constant)).front();
  ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
  ASSERT_EQ(c.scale.family, CurveFamily::spline);
  EXPECT_NEAR(c.range_min_m, 0.2, 1e-12);
  EXPECT_NEAR(c.range_max_m, 4.8, 1e-12);
  const double at[5] = {0.2, 0.7, 1.55, 3.1, 4.8};
  for (int i = 0; i < 5; ++i) {
    // A line in u fits the readings by least squares, the penalised curve nearly.
    EXPECT_NEAR(c.f(at[i]), of_equal_weights.fit[i], 0.3 * of_equal_weights.std_dev[i]);
    // sigma from 22 degrees of freedom beside the line, in place of R's 15.1: sqrt(15.1 / 22) of the part of alpha.
    EXPECT_NEAR(std::sqrt(curve_variance(c, at[i]).value()) / of_equal_weights.std_dev[i], 1.0, 0.15);
  }
  // 8.9 parameters of the curve, one of the noise
  EXPECT_NEAR(0.5 * c.aic.value() - c.joint_nll.value(), of_equal_weights.degrees + 1.0, 1e-3);
}

/// A reading that saturates: no polynomial of order 4.
double bent_curve(double d) { return 0.25 + d + 0.2 * std::tanh(3.0 * (d - 1.5)); }

double of_square(double f) { return 0.004 * f * f; }

Recording drawn(std::uint64_t seed, std::size_t count) {
  Random random(seed);
  return testing::drawn_pairs(random, count, 0.2, 5.0, bent_curve, of_square);
}

TEST(SmoothingSpline, IntervalsOfTheCurveCoverTheTruth) {
  constexpr int worlds = 200;
  int inside = 0, all = 0;
  for (int i = 0; i < worlds; ++i) {
    const Recording recording =
        drawn(seed_from("SmoothingSpline.Intervals", {static_cast<std::uint64_t>(i)}), 300);
    const Calibration c =
        calibrate({&recording, 1}, options_of(CurveFamily::spline, NoiseLaw::f_squared)).front();
    ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
    for (const double d : {0.5, 1.3, 1.6, 2.5, 4.0}) {
      inside += std::abs(c.f(d) - bent_curve(d)) < 1.96 * std::sqrt(curve_variance(c, d).value());
      ++all;
    }
  }
  // Across a curve Bayesian intervals of a smoothing spline cover as stated (Nychka 1988), not at every place of it.
  EXPECT_GT(inside, 0.92 * all);
  EXPECT_LT(inside, 0.985 * all);
}

TEST(SmoothingSpline, IsTakenWhereOrdersDoNotSuffice) {
  const Recording bent = drawn(seed_from("SmoothingSpline.Taken", {}), 400);
  const CalibrationReport report = calibrate_report({&bent, 1}, options_of({}, NoiseLaw::f_squared));
  EXPECT_EQ(report.calibrations.front().scale.family, CurveFamily::spline);
  for (const double d : {0.5, 1.5, 3.0})
    EXPECT_NEAR(least_squares_distance(report.calibrations.front(), bent_curve(d), {}), d, 0.03);

  Random random(seed_from("SmoothingSpline.NotTaken", {}));
  int splines = 0;
  for (int i = 0; i < 100; ++i) {
    const Recording recording = testing::drawn_pairs(
        random, 200, 0.2, 5.0, [](double d) { return 0.05 + 0.9 * d + 0.02 * d * d; }, of_square);
    splines += calibrate({&recording, 1}, options_of({}, NoiseLaw::f_squared)).front().scale.family ==
               CurveFamily::spline;
  }
  EXPECT_LE(splines, 1);
}

TEST(SmoothingSpline, OfACurveThatTurnsIsTheLeastRigidThatDoesNot) {
  std::vector<double> d = fifths(), y;
  for (const double x : d) y.push_back(x < 2.0 ? x : 2.0 - 0.2 * (x - 2.0));
  const auto spline = smoothing_spline(d, y);
  ASSERT_TRUE(spline);
  EXPECT_TRUE(spline->stiffened);
  EXPECT_GT(spline->scale.spline->u.least_slope(), 0.0);
  for (double& reading : y) reading = -reading;  // falls
  ASSERT_TRUE(smoothing_spline(d, y));
}

// Distances that differ by rounding alone, an offset that all readings share, and a thousand repeats at one distance.
TEST(SmoothingSpline, KeepsItsDigits) {
  const std::vector<double> d = fifths();
  const auto plain = smoothing_spline(d, bent_y);
  std::vector<double> twice = d, rounded = d, far = bent_y, with_one_more = bent_y;
  twice.push_back(d[7]);
  rounded.push_back(d[7] * (1.0 + 1e-15));
  with_one_more.push_back(bent_y[7]);
  for (double& y : far) y += 1e6;
  const auto same = smoothing_spline(d, far), exactly = smoothing_spline(twice, with_one_more),
             nearly = smoothing_spline(rounded, with_one_more);
  ASSERT_TRUE(plain && same && exactly && nearly);
  for (const double x : {0.3, 1.7, 4.4}) {
    EXPECT_NEAR(same->scale.of(x), plain->scale.of(x), 1e-6);
    EXPECT_NEAR(nearly->scale.of(x), exactly->scale.of(x), 1e-9);
  }
  std::vector<double> repeats = d, readings = bent_y;
  for (int i = 0; i < 1000; ++i) {
    repeats.push_back(1.0);
    readings.push_back(0.88 + 1e-3 * (i % 5));
  }
  const auto repeated = smoothing_spline(repeats, readings);
  ASSERT_TRUE(repeated);
  EXPECT_EQ(repeated->scale.spline->u.knots().size(), 24);
}

TEST(SmoothingSpline, FollowsReadingsThatFall) {
  std::vector<double> y = bent_y;
  for (double& reading : y) reading = 6.0 - reading;
  const Recording recording = pairs_of(fifths(), y);
  const Calibration c =
      calibrate({&recording, 1}, options_of(CurveFamily::spline, NoiseLaw::constant)).front();
  ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
  EXPECT_LT(c.alpha[1], 0.0);
  for (const double d : {0.5, 2.0, 4.0}) EXPECT_NEAR(least_squares_distance(c, c.f(d), {}), d, 1e-9);
}

TEST(SmoothingSpline, IsNotTakenFromAMethodThatHasNone) {
  const Recording bent = drawn(seed_from("SmoothingSpline.Taken", {}), 400);
  CalibrateOptions options = options_of({}, NoiseLaw::f_squared);
  options.methods = {Method::approximate};
  EXPECT_EQ(calibrate({&bent, 1}, options).front().scale.family, CurveFamily::polynomial);
  options.methods = {Method::marginal, Method::approximate};
  EXPECT_EQ(calibrate({&bent, 1}, options).front().scale.family, CurveFamily::spline);
}

TEST(SmoothingSpline, NoneOfFewDistancesOrReadingsThatStay) {
  EXPECT_FALSE(
      smoothing_spline(std::vector<double>{1, 2, 3, 4, 4, 4}, std::vector<double>{1, 2, 3, 4, 4, 4}));
  EXPECT_FALSE(smoothing_spline(fifths(), std::vector<double>(24, 1.0)));
  const Recording few = pairs_of({1, 2, 3, 4, 4}, {1, 2, 3, 4, 4});
  EXPECT_THROW(calibrate({&few, 1}, options_of(CurveFamily::spline, NoiseLaw::constant)), InputError);
  CalibrateOptions with_order = options_of(CurveFamily::spline, NoiseLaw::constant);
  with_order.order = 2;
  EXPECT_THROW(with_order.check_values(), InputError);
}

}  // namespace
}  // namespace rangecal
