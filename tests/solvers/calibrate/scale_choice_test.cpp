// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/scale_choice.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/proportion.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/correction/correct.hpp"
#include "support/pairs_of.hpp"

namespace rangecal {
namespace {

using testing::pairs_of;

const std::vector<double> certified_d{0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0,
                                      1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.7, 1.8, 1.9};
const std::vector<double> certified_y{2.8214, 2.2530, 1.8836, 1.6257, 1.4455, 1.2989, 1.1980, 1.1205, 1.0277,
                                      0.9638, 0.9216, 0.8743, 0.8317, 0.7861, 0.7640, 0.7434, 0.6981, 0.6844};

Calibration fitted(const Recording& recording, Method method, int order, NoiseLaw law) {
  CalibrateOptions options;
  options.methods = {method};
  options.curve = CurveFamily::reciprocal;
  options.order = order;
  options.noise = law;
  options.noise_shape = NoiseShape::gaussian;
  return calibrate({&recording, 1}, options).front();
}

// scipy.optimize.curve_fit 1.10.1 of a + b / (d + c), tolerances 1e-15; sigma = sqrt(RSS / 18); standard deviations with
// absolute_sigma, of the curve by the delta method.
TEST(ScaleChoice, ReciprocalAgreesWithSciPy) {
  const Calibration c = fitted(pairs_of(certified_d, certified_y), Method::full, 1, NoiseLaw::constant);
  ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
  EXPECT_NEAR(c.alpha[0], 0.24971609, 2e-7);
  EXPECT_NEAR(c.alpha[1], 0.89694618, 2e-7);
  EXPECT_NEAR(c.scale.offset_m, 0.14870364, 1e-7);
  EXPECT_NEAR(c.noise.parameters[0], 0.006541668817, 1e-10);
  EXPECT_NEAR(c.joint_nll.value(), -64.9912399565, 1e-8);
  EXPECT_NEAR(c.scale.offset_std_m.value(), 0.0038381, 2e-6);
  for (const auto& [d, f, std_dev] :
       {std::tuple{0.3, 2.2486884461, 0.0031997854541}, std::tuple{1.0, 1.0305494979, 0.0017307696413},
        std::tuple{1.8, 0.7099944830, 0.0025342188349}}) {
    EXPECT_NEAR(c.f(d), f, 1e-8);
    EXPECT_NEAR(std::sqrt(curve_variance(c, d).value()), std_dev, 2e-7) << d;
  }
  EXPECT_EQ(c.range_min_m, 0.2);
  EXPECT_NEAR(c.range_max_m, 1.9, 1e-12);
  // 4 parameters and the noise's, the offset counted
  EXPECT_NEAR(c.aic.value(), 2.0 * (-64.9912399565 + 4.0), 1e-7);
}

Recording drawn(std::uint64_t seed, double a, double b, double c, double sigma, std::size_t count) {
  Random random(seed);
  return testing::drawn_pairs(
      random, count, 0.2, 3.0, [&](double d) { return a + b / (d + c); }, [&](double) { return sigma; });
}

TEST(ScaleChoice, IntervalsOfOffsetAndCurveCoverTheTruth) {
  constexpr int worlds = 400;
  int offset = 0, curve = 0;
  for (int i = 0; i < worlds; ++i) {
    const Recording recording =
        drawn(seed_from("ScaleChoice.Intervals", {static_cast<std::uint64_t>(i)}), 0.3, 4.0, 0.35, 0.02, 120);
    const Calibration c = fitted(recording, Method::marginal, 1, NoiseLaw::constant);
    ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
    offset += std::abs(c.scale.offset_m - 0.35) < 1.96 * c.scale.offset_std_m.value();
    curve += std::abs(c.f(1.5) - (0.3 + 4.0 / 1.85)) < 1.96 * std::sqrt(curve_variance(c, 1.5).value());
  }
  for (const int covered : {offset, curve}) {
    EXPECT_GE(covered, 0.95 * worlds - 3.0 * std::sqrt(0.95 * 0.05 * worlds));
    EXPECT_LE(covered, 0.95 * worlds + 3.0 * std::sqrt(0.95 * 0.05 * worlds));
  }
}

TEST(ScaleChoice, FallingReadingsGetTheReciprocalByThemselves) {
  const Recording recording = drawn(seed_from("ScaleChoice.Falling", {}), 0.3, 4.0, 0.35, 0.02, 300);
  const CalibrationReport report = calibrate_report({&recording, 1});
  for (const Calibration& c : report.calibrations) {
    if (c.method == Method::approximate) {
      EXPECT_EQ(c.outcome, Outcome::failed);
      EXPECT_NE(c.reason.find("2016, eq. 21"), std::string::npos);
      continue;
    }
    EXPECT_EQ(c.outcome, Outcome::converged) << to_string(c.method);
    EXPECT_EQ(c.scale.family, CurveFamily::reciprocal);
    EXPECT_NEAR(c.f(1.0), 0.3 + 4.0 / 1.35, 0.01) << to_string(c.method);
  }
  const auto tried = [&](CurveFamily family) {
    return std::any_of(report.models.begin(), report.models.end(),
                       [&](const ModelScore& m) { return m.family == family; });
  };
  EXPECT_TRUE(tried(CurveFamily::polynomial) && tried(CurveFamily::reciprocal));
}

TEST(ScaleChoice, OrderOneIsChosenWhereItIsTrue) {
  constexpr int worlds = 60;
  int right = 0;
  CalibrateOptions options;
  options.noise = NoiseLaw::constant;
  for (int i = 0; i < worlds; ++i) {
    const Recording recording =
        drawn(seed_from("ScaleChoice.OrderOne", {static_cast<std::uint64_t>(i)}), 0.3, 4.0, 0.35, 0.02, 200);
    const auto chosen = choose_reciprocal(recording.pairs.true_m, recording.pairs.reading_m, options);
    ASSERT_TRUE(chosen);
    right += chosen->order == 1;
  }
  // A chi-square of 1 to 3 beyond 4 + 2 to 4 + 6: 1.4 % at most; 5 % leaves room for the offset's own search.
  EXPECT_GE(right, 0.95 * worlds - 3.0 * std::sqrt(0.95 * 0.05 * worlds));
}

TEST(ScaleChoice, RisingReadingsStayAPolynomial) {
  Random random(seed_from("ScaleChoice.Rising", {}));
  std::vector<double> d, y;
  for (int i = 0; i < 200; ++i) {
    d.push_back(random.uniform(0.3, 4.0));
    y.push_back(0.05 + 0.98 * d.back() + 0.01 * random.normal());
  }
  EXPECT_FALSE(readings_fall(d, y));
  const Recording recording = pairs_of(d, y);
  EXPECT_FALSE(reciprocal_due(recording, {}));
  for (const Calibration& c : calibrate({&recording, 1})) EXPECT_TRUE(c.scale.is_distance());
}

TEST(ScaleChoice, OutliersDoNotMoveTheOffset) {
  Recording recording = drawn(seed_from("ScaleChoice.Outliers", {}), 0.3, 4.0, 0.35, 0.02, 400);
  for (std::size_t i = 0; i < recording.pairs.size(); i += 25) recording.pairs.reading_m[i] += 1.0;
  const Calibration c = calibrate({&recording, 1}).back();
  ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
  ASSERT_EQ(c.scale.family, CurveFamily::reciprocal);
  EXPECT_NEAR(c.scale.offset_m, 0.35, 4.0 * c.scale.offset_std_m.value());
  EXPECT_NEAR(c.f(1.0), 0.3 + 4.0 / 1.35, 0.01);
}

/// A corrected reading is where the curve reads it, both where the curve turns around.
TEST(ScaleChoice, CorrectFindsEveryDistance) {
  Calibration c;
  c.kind = RecordingKind::pairs;
  c.outcome = Outcome::converged;
  c.scale = {CurveFamily::reciprocal, 0.2, {}};
  c.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.01)};
  c.range_min_m = 0.2;
  c.range_max_m = 4.0;
  c.alpha = Eigen::Vector2d(0.1, 2.0);
  const Correction one = correct(c, 0.1 + 2.0 / 1.4);
  ASSERT_EQ(one.least_squares.size(), 1u);
  EXPECT_NEAR(one.least_squares[0].distance_m, 1.2, 1e-12);
  // (2 / u^2) s: the slope at 1.2 m is -2 / 1.4^2
  EXPECT_NEAR(one.least_squares[0].std_dev_m.value(), 0.01 * 1.96 / 2.0, 1e-9);
  // 1 - 3 u + 4 u^2 turns at u = 3 / 8, d = 8 / 3 - 0.2: it reads the same at u = 0.5 and 0.25.
  c.alpha = Eigen::Vector3d(1.0, -3.0, 4.0);
  const Correction two = correct(c, 0.5);
  ASSERT_EQ(two.least_squares.size(), 2u);
  EXPECT_NEAR(two.least_squares[0].distance_m, 1.8, 1e-10);
  EXPECT_NEAR(two.least_squares[1].distance_m, 3.8, 1e-10);
}

TEST(ScaleChoice, StretchesLeftOutTellTheRightFamily) {
  const Recording recording = drawn(seed_from("ScaleChoice.Stretches", {}), 0.3, 4.0, 0.35, 0.02, 600);
  const auto rms = [&](const CurveScale& scale, int order) {
    return stretches_left_out(recording.pairs.true_m, recording.pairs.reading_m, {}, scale, order)->rms();
  };
  const double reciprocal = rms({CurveFamily::reciprocal, 0.3, {}}, 1);
  EXPECT_NEAR(reciprocal, 0.02, 0.003);  // the noise, from an offset that is off
  EXPECT_GT(rms({}, 4), 1.5 * reciprocal);
  const std::vector<double> few{1.0, 2.0, 3.0, 4.0};
  EXPECT_FALSE(stretches_left_out(few, few, {}, {}, 1));
}

TEST(ScaleChoice, RefusesWhatDoesNotGoTogether) {
  const Recording recording = pairs_of(certified_d, certified_y);
  CalibrateOptions options;
  options.curve = CurveFamily::reciprocal;
  options.noise = NoiseLaw::d_squared;
  EXPECT_THROW(calibrate({&recording, 1}, options), InputError);
  options.noise.reset();
  options.criterion = OrderCriterion::thirds;
  EXPECT_THROW(calibrate({&recording, 1}, options), InputError);
  Recording landmarks;
  landmarks.kind = RecordingKind::landmarks;
  options.criterion = OrderCriterion::aic;
  EXPECT_THROW(calibrate({&landmarks, 1}, options), InputError);
}

}  // namespace
}  // namespace rangecal
