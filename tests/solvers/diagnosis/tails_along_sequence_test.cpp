// SPDX-License-Identifier: BSD-3-Clause
// Readings that follow one another, whose errors wander and have tails: what is predicted of each against integrals, the slopes against
// differences, and fits of recordings whose share of late readings is known.
#include "diagnosis/tails_along_sequence.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/wandering_part.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"
#include "solvers/diagnosis/expect_optimum.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/state_of_pairs.hpp"

namespace rangecal::diagnosis {
namespace {

TEST(WanderingPart, DensityAndMomentsBehindAReadingAreThoseOfTheIntegral) {
  constexpr double q = 0.7, spread = 0.01;
  const WanderingPart::Prediction before{0.4, 0.5, 0.5 + 1.0 - q};
  for (const Contamination& part :
       {Contamination{.share = 0.1, .mean_m = 0.02}, Contamination{.share = 0.3, .extra_sigma_m = 0.05},
        Contamination{.share = 0.2, .mean_m = -0.03, .end_m = 0.04}}) {
    TailLaw law;
    ASSERT_TRUE(law.add(part));
    for (const double error : {-0.05, -0.012, 0.0, 0.015, 0.024, 0.06}) {
      // x ~ N(m, P) before the reading, and the reading's other errors have the law with a spread of s sqrt(1 - q).
      constexpr int steps = 4000;
      const double from = before.mean - 9.0 * std::sqrt(before.variance),
                   step = 18.0 / steps * std::sqrt(0.5);
      double mass = 0.0, first = 0.0, second = 0.0;
      for (int k = 0; k <= steps; ++k) {
        const double x = from + k * step, own = spread * std::sqrt(1.0 - q);
        const double density =
            std::exp(-0.5 * std::pow(x - before.mean, 2) / before.variance - half_log_two_pi) /
            std::sqrt(before.variance) * std::exp(law.density(error - spread * x, own).value) / own;
        mass += step * density;
        first += step * density * x;
        second += step * density * x * x;
      }
      const double own = spread * before.spread();
      TailLaw::Slopes slopes;
      const LogDensity at = law.density(error - spread * before.mean, own, &slopes);
      const auto [mean, variance] = before.behind(at.derivative, slopes.curvature);
      EXPECT_NEAR(at.value - std::log(own), std::log(mass), 1e-7) << error;
      EXPECT_NEAR(mean, first / mass, 1e-7) << error;
      EXPECT_NEAR(variance, second / mass - std::pow(first / mass, 2), 1e-7) << error;
    }
  }
}

/// 500 readings of s = 0.01 f, of whose variance a share wanders with correlation 0.9 a second, and of which a share is late.
Recording late_and_wandering(double late, const std::string& name, std::uint64_t number = 0,
                             double wanders = 0.7) {
  return testing::wandering_pairs(
      {.readings = 500, .sigma = 0.01, .wanders = wanders, .rho = 0.9, .late = late}, name, number);
}

Model late_and_wandering_model(double share, double size, double rho, double q) {
  return {{find_effect("autocorrelated_noise"), Eigen::Vector3d(rho, 0.0, q)},
          {find_effect("late_return"), Eigen::Vector2d(share, size)}};
}

JointState near_truth(const Rows& rows, double sigma) {
  return testing::state_of_pairs(rows, Eigen::Vector3d(0.06, 0.94, 0.021), NoiseLaw::f, sigma);
}

TEST(TailsAlongSequence, NLLIsThatOfTheWorkingProblemAndWithoutTailsThatOfNormalErrors) {
  const Recording recording = late_and_wandering(0.05, "TailsAlongSequence.NLL");
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const JointState state = near_truth(rows, 0.011);
  const CellGeometry geometry = cell_geometry(rows, state);
  const Model model = late_and_wandering_model(0.04, 0.15, 0.8, 0.6);
  const WorkingProblem working = working_problem(rows, model, state);
  EXPECT_NEAR(nll_at(rows, working, state), nll_along_sequence(rows, model, working, geometry), 1e-8);

  const Model without{model[0]}, next_to_none = late_and_wandering_model(1e-14, 0.15, 0.8, 0.6);
  const double normal = nll_at(rows, working_problem(rows, without, state), state);
  // every reading is given what its tail is worth where the tail is all that is left of it: none here
  const Recording clean = late_and_wandering(0.0, "TailsAlongSequence.Clean");
  const Rows of_clean = make_rows({&clean, 1}, {CurveScale{}, 2});
  EXPECT_GT(normal, nll_at(rows, working, state) + 100.0);
  EXPECT_NEAR(nll_at(of_clean, working_problem(of_clean, without, state), state),
              nll_at(of_clean, working_problem(of_clean, next_to_none, state), state), 1e-6);
}

TEST(TailsAlongSequence, OperatorsAreThoseOfOneTriangularMatrix) {
  const Recording recording = late_and_wandering(0.1, "TailsAlongSequence.Operators");
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const JointState state = near_truth(rows, 0.01);
  const SerialErrors serial =
      working_problem(rows, late_and_wandering_model(0.1, 0.2, 0.9, 0.7), state).serial;
  const auto n = static_cast<Eigen::Index>(rows.size());
  const Eigen::MatrixXd K = serial.whitened_columns(SerialErrors::Columns::Identity(n, n));
  Random random(seed_from("TailsAlongSequence.Operators"));
  Eigen::VectorXd x(n);
  for (double& value : x) value = random.normal();
  EXPECT_LT((serial.whitened(x) - K * x).norm(), 1e-10);
  EXPECT_LT((serial.transposed(x) - K.transpose() * x).norm(), 1e-10);
  EXPECT_LT((serial.coloured(serial.whitened(x)) - x).norm(), 1e-10);
  EXPECT_LT((serial.transpose_coloured(serial.transposed(x)) - x).norm(), 1e-10);
  EXPECT_NEAR(serial.log_determinant(), -2.0 * K.diagonal().array().log().sum(), 1e-9);
}

/// NLL as a function of alpha (3), ln sigma, rho, q, share and size of the late readings.
double nll_at_values(const Rows& rows, const Eigen::VectorXd& x) {
  const Model model = late_and_wandering_model(x[6], x[7], x[4], x[5]);
  JointState state = near_truth(rows, std::exp(x[3]));
  state.alpha = x.head(3);
  return nll_at(rows, working_problem(rows, model, state), state);
}

Eigen::VectorXd values_of(const Fit& fit) {
  Eigen::VectorXd x(8);
  x << fit.state.alpha, std::log(fit.state.noise.parameters[0]), fit.model[0].parameters[0],
      fit.model[0].parameters[2], fit.model[1].parameters;
  return x;
}

TEST(TailsAlongSequence, FitEndsWhereTheScoreIsZero) {
  const Recording recording = late_and_wandering(0.08, "TailsAlongSequence.Ends");
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  ASSERT_FALSE(rows.sequence.empty());
  const Fit fit = refit(rows, late_and_wandering_model(0.03, 0.5, 0.5, 0.4), near_truth(rows, 0.03), {});
  ASSERT_TRUE(fit.ok);
  const Eigen::VectorXd found = values_of(fit);
  EXPECT_NEAR(fit.nll, nll_at_values(rows, found), 1e-6);
  std::vector<double> steps;
  for (const double value : found) steps.push_back(1e-4 * std::max(0.05, std::abs(value)));
  testing::expect_optimum([&](const Eigen::VectorXd& x) { return nll_at_values(rows, x); }, found, steps,
                          0.1);
}

TEST(TailsAlongSequence, SharesAndCorrelationsOfManyRecordingsAreThoseTheyWereDrawnWith) {
  constexpr int recordings = 12;
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(8), squares = sum;
  for (int r = 0; r < recordings; ++r) {
    const Recording recording =
        late_and_wandering(0.06, "TailsAlongSequence.Shares", static_cast<std::uint64_t>(r));
    const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
    const Fit fit = refit(rows, late_and_wandering_model(0.03, 0.5, 0.5, 0.4), near_truth(rows, 0.03), {});
    ASSERT_TRUE(fit.ok) << r;
    sum += values_of(fit);
    squares += values_of(fit).cwiseAbs2();
  }
  const Eigen::VectorXd mean = sum / recordings;
  const Eigen::VectorXd error =
      ((squares / recordings - mean.cwiseAbs2()) / (recordings - 1)).cwiseSqrt();  // of the mean
  Eigen::VectorXd truth(8);
  truth << 0.05, 0.95, 0.02, std::log(0.01), 0.9, 0.7, 0.06, 0.2;
  // Of 5 parameters the largest t of 11 degrees of freedom exceeds 4.2 with a probability of 0.7 %.
  for (Eigen::Index j = 3; j < truth.size(); ++j)
    EXPECT_LT(std::abs(mean[j] - truth[j]), 4.2 * error[j]) << j << ": " << mean[j] << " +- " << error[j];
}

/// The scores of questions about tails that the fits of many recordings leave.
std::vector<double> scores_left(const char* shape, bool along) {
  std::vector<double> scores;
  for (std::uint64_t r = 0; r < 30; ++r) {
    Recording recording = late_and_wandering(0.06, "TailsAlongSequence.Left", r, along ? 0.7 : 0.0);
    Model model = late_and_wandering_model(0.03, 0.5, 0.5, 0.4);
    if (!along) {
      recording.pairs.time_s.clear();
      model.erase(model.begin());
    }
    const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
    const Fit fit = refit(rows, model, near_truth(rows, 0.03), {});
    for (const Question& q : Battery(rows, fit.model, fit.state).questions)
      if (q.channel == "range_tail" && q.shape == shape && q.z) scores.push_back(*q.z);
  }
  return scores;
}

TEST(TailsAlongSequence, WhatTheRightLawLeavesOfReadingsReadOnceIsNormal) {
  for (const bool along : {true, false})
    for (const char* shape : {"heavy tails", "skew"}) {
      const std::vector<double> z = scores_left(shape, along);
      ASSERT_EQ(z.size(), 30u) << shape;
      double squares = 0.0;
      for (const double each : z) squares += each * each;
      // chi-square of 30 degrees of freedom: above 59.7 once in a thousand; the fitted law takes up part of it
      EXPECT_LT(squares, 59.7) << shape << ' ' << along;
    }
}

}  // namespace
}  // namespace rangecal::diagnosis
