// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal {
namespace {

struct Stream {
  std::vector<double> d, y;
};

/// y ~ N(f, (0.02 f^2)^2) at distances of 0.3 to 5 m; f the curve of the 2016 paper.
Stream draw(std::uint64_t repeat, int count,
            const Eigen::VectorXd& alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584)) {
  Random random(seed_from("recursive", {repeat}));
  Stream stream;
  for (int i = 0; i < count; ++i) {
    const double d = random.uniform(0.3, 5.0), f = evaluate_polynomial(alpha, d);
    stream.d.push_back(d);
    stream.y.push_back(random.normal(f, 0.02 * f * f));
  }
  return stream;
}

RecursiveCalibrator after(const Stream& stream, const RecursiveOptions& options) {
  RecursiveCalibrator tracked(options);
  for (std::size_t i = 0; i < stream.d.size(); ++i) tracked.add(stream.d[i], stream.y[i]);
  return tracked;
}

/// Adds readings begin to end - 1; an estimate after each whose number leaves `rest` when divided by `every`.
void take(RecursiveCalibrator& tracked, const Stream& stream, std::size_t begin, std::size_t end,
          std::size_t every, std::size_t rest) {
  for (std::size_t i = begin; i < end; ++i) {
    tracked.add(stream.d[i], stream.y[i]);
    if (i % every == rest) tracked.full();
  }
}

Recording recording_of(const Stream& stream) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.pairs.true_m = stream.d;
  recording.pairs.reading_m = stream.y;
  return recording;
}

TEST(RecursiveCalibrator, ApproximateIsTheBatchAnswer) {
  for (const int count : {6, 40, 3000}) {
    for (const int order : {0, 1, 2, 3}) {
      for (const NoiseLaw law : {NoiseLaw::f_squared, NoiseLaw::d_squared, NoiseLaw::f}) {
        const Stream stream = draw(static_cast<std::uint64_t>(count), count);
        RecursiveOptions options;
        options.order = order;
        options.law = law;
        const Calibration ours = after(stream, options).approximate();
        ClosedFormOptions closed;
        closed.order = order;
        closed.noise_law = law;
        const Calibration batch = approximate_pairs(recording_of(stream), closed);
        ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
        for (int i = 0; i <= order; ++i)
          EXPECT_NEAR(ours.alpha[i], batch.alpha[i], 1e-8) << count << " order " << order;
        EXPECT_NEAR(ours.noise.parameters[0], batch.noise.parameters[0], 1e-8);
        // 1 / s^2 of the cells, interpolated over a bin: of six readings it follows a curve that bends to where s is 0
        const double theirs = *batch.noise_estimates[0].std_dev;
        const double allowed = law == NoiseLaw::d_squared ? 1e-7 : 1e-3;
        if (law == NoiseLaw::d_squared || count > 6) {
          EXPECT_NEAR(*ours.noise_estimates[0].std_dev, theirs, allowed * theirs)
              << count << " order " << order;
        }
        // interpolated over a bin, 1e-6 where few readings let f bend strongly
        EXPECT_LT((*ours.alpha_covariance - *batch.alpha_covariance).norm(),
                  1e-5 * batch.alpha_covariance->norm());
      }
    }
  }
}

TEST(RecursiveCalibrator, FullIsTheBatchAnswerWithinOneHundredthOfItsStandardDeviation) {
  for (const int count : {30, 500, 50000}) {
    for (const NoiseLaw law :
         {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed, NoiseLaw::d_squared}) {
      const Stream stream = draw(7, count);
      RecursiveOptions options;
      options.law = law;
      options.noise_shape = NoiseShape::gaussian;
      RecursiveCalibrator tracked(options);
      Calibration ours;
      take(tracked, stream, 0, stream.d.size(), 1000, 20);  // estimates on the way change nothing
      ours = tracked.full();
      PairsOptions pairs;
      pairs.law = law;
      const PairsFit batch = full_pairs(make_pairs_problem(stream.d, stream.y), pairs);
      ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason << " " << to_string(law) << count;
      for (int i = 0; i < 3; ++i) {
        const double std_dev = std::sqrt((*batch.calibration.alpha_covariance)(i, i));
        EXPECT_NEAR(ours.alpha[i], batch.calibration.alpha[i], 0.01 * std_dev) << to_string(law) << count;
      }
      EXPECT_NEAR(ours.noise.parameters[0], batch.calibration.noise.parameters[0],
                  0.01 * *batch.calibration.noise_estimates[0].std_dev);
      EXPECT_LT((*ours.alpha_covariance - *batch.calibration.alpha_covariance).norm(),
                1e-5 * batch.calibration.alpha_covariance->norm());
      EXPECT_NEAR(*ours.joint_nll, batch.nll, 1e-8 * std::abs(batch.nll) + 1e-4);
    }
  }
}

TEST(RecursiveCalibrator, PolynomialNoiseIsTheBatchAnswerWithinOneHundredthOfItsStandardDeviation) {
  // s = 0.004 + 0.006 d: what 2021 eq. 3, 4 have, of first and second order, and a spread of one value, order 0.
  for (const int noise_order : {0, 1, 2}) {
    for (const int count : {200, 5000}) {
      Random random(seed_from("recursive polynomial noise", {static_cast<std::uint64_t>(count)}));
      const Eigen::Vector3d alpha(0.0525, 0.8838, 0.0584);
      RecursiveOptions options;
      options.law = NoiseLaw::polynomial;
      options.noise_order = noise_order;
      options.noise_shape = NoiseShape::gaussian;
      RecursiveCalibrator tracked(options);
      std::vector<double> d, y;
      for (int i = 0; i < count; ++i) {
        d.push_back(random.uniform(0.3, 5.0));
        y.push_back(random.normal(evaluate_polynomial(alpha, d.back()),
                                  noise_order == 0 ? 0.01 : 0.004 + 0.006 * d.back()));
        tracked.add(d.back(), y.back());
        if (i % 70 == 30) tracked.full();
        if (i == 100) tracked = RecursiveCalibrator::from_json(tracked.to_json(), "state");
      }
      const Calibration ours = tracked.full();
      PairsOptions pairs;
      pairs.law = NoiseLaw::polynomial;
      pairs.noise_order = noise_order;
      const Calibration batch = full_pairs(make_pairs_problem(d, y), pairs).calibration;
      ASSERT_EQ(batch.outcome, Outcome::converged) << batch.reason;
      ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason << noise_order;
      ASSERT_EQ(ours.noise.parameters.size(), noise_order + 1);
      for (int i = 0; i < 3; ++i)
        EXPECT_NEAR(ours.alpha[i], batch.alpha[i], 0.01 * std::sqrt((*batch.alpha_covariance)(i, i)))
            << noise_order << " " << count;
      for (int j = 0; j <= noise_order; ++j) {
        const double std_dev = *batch.noise_estimates[static_cast<std::size_t>(j)].std_dev;
        EXPECT_NEAR(ours.noise.parameters[j], batch.noise.parameters[j], 0.01 * std_dev);
        EXPECT_NEAR(*ours.noise_estimates[static_cast<std::size_t>(j)].std_dev, std_dev, 1e-4 * std_dev);
      }
      EXPECT_EQ(tracked.approximate().noise.law, NoiseLaw::f_squared);
    }
  }
}

TEST(RecursiveCalibrator, TracksTheOrder) {
  for (const auto& [alpha, order] : {std::pair<Eigen::VectorXd, int>{Eigen::Vector2d(0.05, 0.9), 1},
                                     {Eigen::Vector3d(0.0525, 0.8838, 0.0584), 2}}) {
    const Stream stream = draw(11, 2000, alpha);
    RecursiveOptions options;
    options.order.reset();
    RecursiveCalibrator tracked = after(stream, options);
    PairsOptions pairs;
    pairs.order.reset();
    const PairsFit batch = full_pairs(make_pairs_problem(stream.d, stream.y), pairs);
    EXPECT_EQ(tracked.full().order(), batch.calibration.order());
    EXPECT_GE(tracked.full().order(), order);
    EXPECT_GE(tracked.approximate().order(), order);
  }
}

TEST(RecursiveCalibrator, ForgetsWithItsTimeConstant) {
  // Weights exp(-age / 100 s), the batch's with the same weights as reference; one reading a second, out of order in places.
  const Stream stream = draw(13, 5000);
  RecursiveOptions options;
  options.forget = 100.0;
  options.law = NoiseLaw::d_squared;
  RecursiveCalibrator tracked(options);
  std::vector<double> weights;
  for (std::size_t i = 0; i < stream.d.size(); ++i) {
    const double time = 1e6 + static_cast<double>(i % 7 == 3 ? i - 2 : i);
    tracked.add(stream.d[i], stream.y[i], time);
    weights.push_back(std::exp((time - 1e6 - 4999.0) / 100.0) / std::pow(stream.d[i], 4));
  }
  // sum over ages of exp(-age / 100) = 1 / (1 - e^-0.01) = 100.5, of its square 50.25: 100.5^2 / 50.25 = 201
  EXPECT_NEAR(tracked.effective_readings(), 201.0, 2.0);
  const PolynomialFit batch = fit_polynomial(stream.d, stream.y, 2, weights);
  const Calibration ours = tracked.approximate();
  for (int i = 0; i < 3; ++i) EXPECT_NEAR(ours.alpha[i], batch.alpha[i], 1e-8);
}

TEST(RecursiveCalibrator, FollowsADriftThatTheStateWithoutForgettingAverages) {
  Random random(seed_from("recursive drift"));
  RecursiveOptions options;
  options.order = 1;
  options.law = NoiseLaw::constant;
  RecursiveCalibrator all(options);
  options.forget = 200.0;
  RecursiveCalibrator recent(options);
  for (int i = 0; i < 10000; ++i) {  // the offset creeps from 0 to 0.1 m, 2 mm in 200 readings
    const double d = random.uniform(0.5, 4.0), y = 1e-5 * i + d + random.normal(0.0, 0.01);
    all.add(d, y);
    recent.add(d, y);
  }
  // weighted mean age 200 readings: 0.1 - 0.002, +- 0.01 / sqrt(400) = 0.5 mm at mid range, times 3 at d = 0
  EXPECT_NEAR(recent.full().alpha[0], 0.098, 0.006);
  EXPECT_NEAR(all.full().alpha[0], 0.05, 0.002);
}

TEST(RecursiveCalibrator, CovarianceOfForgettingHolds) {
  // 400 streams; the share of |alpha_1 - truth| < 1.96 standard deviations is binomial: 0.95 +- 4 * 0.011
  RecursiveOptions options;
  options.forget = 60.0;
  int held = 0;
  for (std::uint64_t repeat = 0; repeat < 400; ++repeat) {
    const Calibration fit = after(draw(1000 + repeat, 400), options).full();
    ASSERT_EQ(fit.outcome, Outcome::converged);
    held += std::abs(fit.alpha[1] - 0.8838) < 1.96 * std::sqrt((*fit.alpha_covariance)(1, 1));
  }
  EXPECT_NEAR(held / 400.0, 0.95, 0.044);
}

TEST(RecursiveCalibrator, CovarianceOfForgettingHoldsForDistancesOfLongAgo) {
  // 100 pairs at 0.3 to 0.8 m, then 200 at 2 to 5 m, forgotten with 60 readings: what is known at 0.5 m is old and
  // light. z = (f - truth) / std there, of 400 streams; the mean of z^2 is 1 +- 4 sqrt(2 / 400) = 0.28. With one factor
  // (sum w^2 / sum w) for all distances it is 0.11.
  for (const bool approximate : {true, false}) {
    RecursiveOptions options;
    options.order = 1;
    options.law = NoiseLaw::d_squared;
    options.forget = 60.0;
    double squares = 0.0;
    for (std::uint64_t repeat = 0; repeat < 400; ++repeat) {
      Random random(seed_from("recursive long ago", {repeat}));
      RecursiveCalibrator tracked(options);
      for (int i = 0; i < 300; ++i) {
        const double d = i < 100 ? random.uniform(0.3, 0.8) : random.uniform(2.0, 5.0);
        tracked.add(d, random.normal(0.0525 + 0.8838 * d, 0.02 * d * d));
      }
      const Calibration fit = approximate ? tracked.approximate() : tracked.full();
      ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
      const Eigen::Vector2d at(1.0, 0.5);
      const double off = at.dot(fit.alpha - Eigen::Vector2d(0.0525, 0.8838));
      squares += off * off / at.dot(*fit.alpha_covariance * at);
    }
    EXPECT_NEAR(squares / 400.0, 1.0, 0.28) << approximate;
  }
}

TEST(RecursiveCalibrator, StateIsSavedWholeAndGoesOnBitByBit) {
  const Stream stream = draw(17, 900);
  RecursiveOptions options;
  options.order.reset();
  options.forget = 300.0;
  RecursiveCalibrator whole(options), first(options);
  for (std::size_t i = 0; i < stream.d.size(); ++i) whole.add(stream.d[i], stream.y[i]);
  for (std::size_t i = 0; i < 400; ++i) first.add(stream.d[i], stream.y[i]);
  first.add(-1.0, 2.0);
  RecursiveCalibrator second = RecursiveCalibrator::from_json(first.to_json(), "state");
  EXPECT_EQ(second.to_json(), first.to_json());
  EXPECT_EQ(second.counts().dropped.size(), 1u);
  for (std::size_t i = 400; i < stream.d.size(); ++i) second.add(stream.d[i], stream.y[i]);
  EXPECT_EQ(second.full().alpha, whole.full().alpha);
  EXPECT_EQ(second.approximate().alpha, whole.approximate().alpha);
  EXPECT_THROW(RecursiveCalibrator::from_json("{}", "state"), InputError);
  EXPECT_THROW(RecursiveCalibrator::from_json("not json", "state"), InputError);
  std::string broken = first.to_json();
  broken.replace(broken.find("recursive/2"), 11, "recursive/9");
  EXPECT_THROW(RecursiveCalibrator::from_json(broken, "state"), InputError);
}

/// The stream with a share of readings gross (anything from 0.1 to 6 m) or late by 0.3 m in the mean.
Stream with_outliers(std::uint64_t repeat, int count, double gross, double late) {
  Stream stream = draw(repeat, count);
  Random random(seed_from("recursive outliers", {repeat}));
  for (double& y : stream.y) {
    if (random.uniform(0.0, 1.0) < gross) y = random.uniform(0.1, 6.0);
    if (random.uniform(0.0, 1.0) < late) y -= 0.3 * std::log(random.uniform(1e-9, 1.0));
  }
  return stream;
}

TEST(RecursiveCalibrator, IsTheBatchAnswerUnderOutliers) {
  // The batch: full_pairs on all readings with the family that the stream has chosen.
  for (const auto& [gross, late] :
       {std::pair{0.002, 0.0}, {0.01, 0.0}, {0.05, 0.0}, {0.0, 0.01}, {0.0, 0.05}}) {
    double ours_sq = 0.0, batch_sq = 0.0;
    for (std::uint64_t repeat = 0; repeat < 3; ++repeat) {
      const Stream stream = with_outliers(repeat, 3000, gross, late);
      RecursiveCalibrator tracked;
      take(tracked, stream, 0, stream.d.size(), 100, 20);
      const Calibration ours = tracked.full();
      ASSERT_EQ(ours.outcome, Outcome::converged) << ours.reason;
      ASSERT_EQ(ours.noise_shapes.count("range"), 1u) << gross << ' ' << late << ' ' << repeat;
      PairsOptions pairs;
      pairs.shape = noise_shape_of(ours, "range").shape;
      const PairsFit batch = full_pairs(make_pairs_problem(stream.d, stream.y), pairs);
      ASSERT_EQ(batch.calibration.outcome, Outcome::converged);
      for (int i = 0; i < 3; ++i) {
        const double std_dev = std::sqrt((*batch.calibration.alpha_covariance)(i, i));
        EXPECT_NEAR(ours.alpha[i], batch.calibration.alpha[i], 0.05 * std_dev) << gross << ' ' << late;
        EXPECT_NEAR(std::sqrt((*ours.alpha_covariance)(i, i)), std_dev, 0.02 * std_dev);
      }
      EXPECT_NEAR(*ours.joint_nll, batch.nll, 1e-3 * std::abs(batch.nll));
      for (double d = 0.5; d < 5.0; d += 0.5) {
        const double truth = evaluate_polynomial(Eigen::Vector3d(0.0525, 0.8838, 0.0584), d);
        ours_sq += std::pow(evaluate_polynomial(ours.alpha, d) - truth, 2);
        batch_sq += std::pow(evaluate_polynomial(batch.calibration.alpha, d) - truth, 2);
      }
    }
    EXPECT_LT(std::sqrt(ours_sq / batch_sq), 1.02) << gross << ' ' << late;
  }
}

TEST(RecursiveCalibrator, AReadingOfTheOtherSideChoosesTheFamilyAnew) {
  // Reading 1250 is early by 8 spreads, 1480 late by 505. The optimum of early echoes alone with the latter has 13 times the sigma.
  const Stream stream = with_outliers(0, 1521, 0.002, 0.0);
  RecursiveCalibrator tracked;
  take(tracked, stream, 0, 1421, 100, 20);
  const NoiseShapeParameters early = noise_shape_of(tracked.full(), "range");
  EXPECT_EQ(early.shape, NoiseShape::one_sided);
  EXPECT_LT(early.outlier_mean, 0.0);
  take(tracked, stream, 1421, stream.d.size(), 100, 20);
  const Calibration answer = tracked.full();
  EXPECT_EQ(noise_shape_of(answer, "range").shape, NoiseShape::contaminated);
  EXPECT_NEAR(answer.noise.parameters[0], 0.02, 5.0 * 0.02 / std::sqrt(2.0 * 1521));
}

TEST(RecursiveCalibrator, IntervalsHoldUnderOutliers) {
  // z^2 = e^T C^-1 e / 3 of alpha over 60 streams: mean 1, variance 2 / 3 / 60, +- 4 of its deviations = 0.42; with
  // forgetting and without.
  for (const double forget : {std::numeric_limits<double>::infinity(), 200.0}) {
    double squares = 0.0;
    for (std::uint64_t repeat = 0; repeat < 60; ++repeat) {
      const Stream stream = with_outliers(100 + repeat, 600, 0.03, 0.0);
      RecursiveOptions options;
      options.forget = forget;
      RecursiveCalibrator tracked = after(stream, options);
      const Calibration fit = tracked.full();
      ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
      const Eigen::Vector3d error = fit.alpha - Eigen::Vector3d(0.0525, 0.8838, 0.0584);
      squares += error.dot(fit.alpha_covariance->inverse() * error) / 3.0;
    }
    EXPECT_NEAR(squares / 60.0, 1.0, 0.42) << forget;
  }
}

TEST(RecursiveCalibrator, StateWithOutliersGoesOnBitByBit) {
  const Stream stream = with_outliers(3, 1500, 0.01, 0.05);
  RecursiveCalibrator whole, first;
  take(whole, stream, 0, 1500, 50, 49);
  take(first, stream, 0, 700, 50, 49);
  RecursiveCalibrator second = RecursiveCalibrator::from_json(first.to_json(), "state");
  EXPECT_EQ(second.to_json(), first.to_json());
  take(second, stream, 700, 1500, 50, 49);
  EXPECT_EQ(second.to_json(), whole.to_json());
  EXPECT_EQ(second.full().alpha, whole.full().alpha);
  for (const auto& [field, with] : {std::pair<std::string, std::string>{"\"first\":[", "\"first\":[7,"},
                                    {"\"choose_at\":", "\"choose_at\":-"},
                                    {"\"last_shape\":[\"", "\"last_shape\":[\"un"}}) {
    std::string broken = first.to_json();
    ASSERT_NE(broken.find(field), std::string::npos) << field;
    broken.replace(broken.find(field), field.size(), with);
    EXPECT_THROW(RecursiveCalibrator::from_json(broken, "state"), InputError) << field;
  }
}

TEST(RecursiveCalibrator, TakesStatesOfGaussianNoise) {
  // A state of version 1 has no cells of residuals: its noise stays Gaussian.
  RecursiveOptions options;
  options.noise_shape = NoiseShape::gaussian;
  RecursiveCalibrator tracked = after(draw(5, 200), options);
  nlohmann::ordered_json state = nlohmann::ordered_json::parse(tracked.to_json());
  state["format"] = "rangecal-recursive/1";
  for (const char* field : {"noise_shape", "last_shape", "choose_at", "residuals"})
    ASSERT_EQ(state.erase(field), 1u) << field;
  RecursiveCalibrator restored = RecursiveCalibrator::from_json(state.dump(), "state");
  EXPECT_EQ(restored.options().noise_shape, NoiseShape::gaussian);
  EXPECT_EQ(restored.full().alpha, tracked.full().alpha);
}

TEST(RecursiveCalibrator, RefusesStatesByTheField) {
  const Stream stream = with_outliers(3, 1500, 0.01, 0.05);
  RecursiveCalibrator tracked;
  take(tracked, stream, 0, stream.d.size(), 50, 49);
  using Json = nlohmann::ordered_json;
  const auto error = [&](const std::function<void(Json&)>& breaks) -> std::string {
    Json state = Json::parse(tracked.to_json());
    breaks(state);
    try {
      RecursiveCalibrator::from_json(state.dump(), "state");
    } catch (const InputError& caught) {
      return caught.what();
    }
    return "none";
  };
  EXPECT_EQ(error([](Json&) {}), "none");
  EXPECT_EQ(error([](Json& s) { s["last_sigma"] = 0.01, s.erase("last_noise"); }), "none");  // of 0.1.0
  EXPECT_EQ(error([](Json& s) { s.erase("weights"); }), "state: field 'weights': is missing");
  EXPECT_THAT(error([](Json& s) { s["wieghts"] = 1; }),
              ::testing::StartsWith("state: field 'wieghts': is unknown; known here: format, range_m"));
  EXPECT_EQ(error([](Json& s) { s["counts"]["used"] = -1; }),
            "state: field 'counts.used': is not a whole number from 0 to 2147483647");
  EXPECT_EQ(error([](Json& s) { s["bins"][1]["bin"] = 100000; }),
            "state: field 'bins[1].bin': is outside the range");
  EXPECT_EQ(error([](Json& s) { s["bins"][0]["sums"][3][7] = nullptr; }),
            "state: field 'bins[0].sums[3][7]': is not finite");
  EXPECT_EQ(error([](Json& s) {
              s["residuals"]["bins"][0]["cells"] = {{3, {0, 0, 0, 0, 0, 0, 0}}};
            }),
            "state: field 'residuals.bins[0].cells[0]': holds a weight that is not positive");
  EXPECT_EQ(error([](Json& s) { s["triangle"][1].push_back(0.0); }),
            "state: field 'triangle[1]': is not 3 finite numbers");
}

TEST(RecursiveCalibrator, HostileInput) {
  RecursiveCalibrator tracked;
  const double nan = std::nan("");
  EXPECT_FALSE(tracked.add(nan, 1.0));
  EXPECT_FALSE(tracked.add(1.0, nan));
  EXPECT_FALSE(tracked.add(1.0, 0.0));
  EXPECT_FALSE(tracked.add(1.0, -1.0));
  EXPECT_FALSE(tracked.add(1e9, 1.0));
  EXPECT_FALSE(tracked.add(1.0, INFINITY));
  EXPECT_EQ(tracked.used(), 0);
  EXPECT_EQ(tracked.counts().read, 6);
  EXPECT_EQ(tracked.approximate().outcome, Outcome::too_few_data);
  EXPECT_EQ(tracked.full().outcome, Outcome::too_few_data);
  for (int i = 0; i < 10; ++i)
    tracked.add(1.0 + i % 2, 1.1 + i % 2 + 0.01 * i);  // two distances, three coefficients
  EXPECT_EQ(tracked.approximate().outcome, Outcome::too_few_data);
  EXPECT_FALSE(is_usable(tracked.full().outcome));
  EXPECT_THROW(tracked.add(1.0, 1.0, 5.0), InputError);  // a time where the others have none
  RecursiveCalibrator perfect;
  for (int i = 1; i < 10; ++i) perfect.add(0.3 * i, 0.3 * i);
  EXPECT_FALSE(is_usable(perfect.full().outcome));
  RecursiveOptions bad;
  bad.range_max_m = 0.01;
  EXPECT_THROW(RecursiveCalibrator{bad}, InputError);
  bad = {};
  bad.forget = 0.0;
  EXPECT_THROW(RecursiveCalibrator{bad}, InputError);
  bad = {};
  bad.noise_order = -1;
  EXPECT_THROW(RecursiveCalibrator{bad}, InputError);
  RecursiveOptions noise;
  noise.law = NoiseLaw::polynomial;
  RecursiveCalibrator exact(noise);
  for (int i = 1; i < 40; ++i) exact.add(0.1 * i, 0.1 * i);
  EXPECT_FALSE(is_usable(exact.full().outcome));
}

}  // namespace
}  // namespace rangecal
