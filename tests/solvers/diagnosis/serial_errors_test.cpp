// SPDX-License-Identifier: BSD-3-Clause
// Errors that wander along a sequence of readings: the operators against dense matrices, the fit against generalised least
// squares, and whole diagnoses of readings that were taken on the way.
#include "diagnosis/serial_errors.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <string>

#include "diagnosis/known_distances.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/rows.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/state_of_pairs.hpp"

namespace rangecal::diagnosis {
namespace {

/// Two devices whose readings alternate, with gaps of 1 to 4; the second's rows run backwards.
Sequence two_devices(int n) {
  Sequence s;
  s.before.assign(static_cast<std::size_t>(n), -1);
  s.gap.assign(static_cast<std::size_t>(n), 0.0);
  for (int i = 0; i < n; i += 2) s.order.push_back(i);
  for (int i = n - 1 - n % 2; i > 0; i -= 2) s.order.push_back(i);
  for (std::size_t j = 1; j < s.order.size(); ++j) {
    if (s.order[j] % 2 != s.order[j - 1] % 2) continue;
    s.before[static_cast<std::size_t>(s.order[j])] = s.order[j - 1];
    s.gap[static_cast<std::size_t>(s.order[j])] = 1.0 + static_cast<double>(j % 4);
  }
  return s;
}

/// corr(e_i, e_j) = q rho^(gaps between) within a device, 0 between devices, 1 on the diagonal.
Eigen::MatrixXd dense(const Sequence& s, double q, double rho) {
  const auto n = static_cast<Eigen::Index>(s.order.size());
  Eigen::MatrixXd C = Eigen::MatrixXd::Identity(n, n);
  for (const int later : s.order) {
    double apart = 0.0;
    for (int row = later; s.before[static_cast<std::size_t>(row)] >= 0;) {
      apart += s.gap[static_cast<std::size_t>(row)];
      row = s.before[static_cast<std::size_t>(row)];
      C(later, row) = C(row, later) = q * std::pow(rho, apart);
    }
  }
  return C;
}

Eigen::VectorXd drawn(Eigen::Index n, const std::string& name) {
  Random random(seed_from(name));
  Eigen::VectorXd x(n);
  for (double& value : x) value = random.normal();
  return x;
}

TEST(SerialErrors, OperatorsAreThoseOfTheDenseCovariance) {
  const Sequence s = two_devices(31);
  for (const double q : {0.3, 0.9}) {
    const SerialErrors serial(s, q, 0.8);
    const Eigen::MatrixXd C = dense(s, q, 0.8);
    const Eigen::Index n = C.rows();
    Eigen::MatrixXd K(n, n);
    for (Eigen::Index j = 0; j < n; ++j) K.col(j) = serial.whitened(Eigen::VectorXd::Unit(n, j));
    EXPECT_LT((K * C * K.transpose() - Eigen::MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff(), 1e-13);
    EXPECT_NEAR(serial.log_determinant(), std::log(C.determinant()), 1e-11);
    const Eigen::VectorXd x = drawn(n, "SerialErrors.Operators");
    EXPECT_LT((serial.whitened_columns(SerialErrors::Columns::Identity(n, n)) - K).norm(), 1e-12);
    EXPECT_LT((serial.transposed(x) - K.transpose() * x).norm(), 1e-12);
    EXPECT_LT((serial.coloured(serial.whitened(x)) - x).norm(), 1e-12);
    EXPECT_LT((serial.transpose_coloured(serial.transposed(x)) - x).norm(), 1e-12);
  }
}

TEST(SerialErrors, AllOfTheNoiseWanderingIsAR1) {
  Sequence s;
  s.order = {0, 1, 2};
  s.before = {-1, 0, 1};
  s.gap = {0.0, 1.0, 1.0};
  const Eigen::Vector3d u = SerialErrors(s, 1.0, 0.6).whitened(Eigen::Vector3d(1.0, 2.0, -1.0));
  EXPECT_NEAR(u[0], 1.0, 1e-15);
  EXPECT_NEAR(u[1], (2.0 - 0.6) / 0.8, 1e-15);
  EXPECT_NEAR(u[2], (-1.0 - 1.2) / 0.8, 1e-15);
}

TEST(SerialErrors, WithoutShareOrSequenceErrorsAreIndependent) {
  EXPECT_TRUE(SerialErrors().independent());
  EXPECT_TRUE(SerialErrors(two_devices(5), 0.0, 0.5).independent());
  EXPECT_TRUE(SerialErrors(two_devices(5), 0.5, 0.0).independent());
  EXPECT_TRUE(SerialErrors(Sequence{}, 0.5, 0.5).independent());
}

TEST(SerialErrors, WhatIsLeftOutLengthensTheGaps) {
  const Sequence s = two_devices(21);
  const std::vector<int> kept = {0, 1, 5, 6, 7, 12, 15, 20};
  const Sequence part = s.of(kept);
  const Eigen::MatrixXd whole = dense(s, 0.7, 0.9), own = dense(part, 0.7, 0.9);
  for (std::size_t i = 0; i < kept.size(); ++i)
    for (std::size_t j = 0; j < kept.size(); ++j)
      EXPECT_NEAR(own(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)), whole(kept[i], kept[j]),
                  1e-14);
  EXPECT_TRUE(Sequence{}.of(kept).empty());
}

/// 400 known distances on a way there and back, read every 0.1 s: f = 0.05 + 0.95 d + 0.02 d^2, s = `sigma` f^`power`;
/// `share` of the noise wanders with the correlation `rho` from one reading to the next.
Recording on_the_way(double share, double rho, int power, const std::string& name, std::uint64_t seed,
                     int n = 400) {
  Random random(seed_from(name, {seed}));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  double slow = random.normal();
  for (int i = 0; i < n; ++i) {
    const double d = 2.5 - 2.0 * std::cos(0.037 * i) + 1e-4 * i, f = 0.05 + d * (0.95 + 0.02 * d);
    if (i > 0) slow = rho * slow + std::sqrt(1.0 - rho * rho) * random.normal();
    const double e = std::sqrt(share) * slow + std::sqrt(1.0 - share) * random.normal();
    recording.pairs.true_m.push_back(d);
    recording.pairs.time_s.push_back(0.1 * i);
    recording.pairs.reading_m.push_back(f + 0.004 * std::pow(f, power) * e);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

JointState near_truth(const Rows& rows, NoiseLaw law) {
  return testing::state_of_pairs(rows, Eigen::Vector3d(0.06, 0.94, 0.021), law, 0.005);
}

TEST(SerialErrors, TheFitIsGeneralisedLeastSquaresWhereTheSpreadIsConstant) {
  const Recording recording = on_the_way(0.6, 0.9, 0, "SerialErrors.Fit", 0, 80);
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  ASSERT_EQ(rows.sequence.links(), 79);
  ASSERT_EQ(rows.cell_count, 80);
  const SerialErrors serial(rows.sequence, 0.6, 0.9);
  const JointState start = near_truth(rows, NoiseLaw::constant);
  const MarginalFit fit = solve_with_serial_errors(rows.problem, serial, start, Held{});
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  const Eigen::Index n = 80;
  Eigen::MatrixXd X(n, 3);
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double d = recording.pairs.true_m[static_cast<std::size_t>(i)];
    X.row(i) << 1.0, d, d * d;
    y[i] = recording.pairs.reading_m[static_cast<std::size_t>(i)];
  }
  const Eigen::MatrixXd W = dense(rows.sequence, 0.6, 0.9).inverse();
  const Eigen::Matrix3d covariance = (X.transpose() * W * X).inverse();
  const Eigen::Vector3d alpha = covariance * X.transpose() * W * y;
  const double squares = (y - X * alpha).dot(W * (y - X * alpha)), variance = squares / (n - 3);  // REML
  EXPECT_LT((fit.state.alpha - alpha).norm(), 1e-8);
  EXPECT_NEAR(fit.state.noise.parameters[0], std::sqrt(variance), 1e-9);
  ASSERT_TRUE(fit.covariance.has_value());
  EXPECT_LT((fit.covariance->topLeftCorner(3, 3) - variance * covariance).norm(),
            1e-6 * covariance.norm() * variance);
  const double nll = n * (0.5 * std::log(variance) + half_log_two_pi) + 0.5 * squares / variance;
  EXPECT_NEAR(fit.marginal_nll + rows.nll_offset, nll, 1e-7);
}

TEST(SerialErrors, TheFitIsAMinimumWhereTheSpreadFollowsTheCurve) {
  const Recording recording = on_the_way(0.6, 0.9, 2, "SerialErrors.Minimum", 0, 120);
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const SerialErrors serial(rows.sequence, 0.6, 0.9);
  const JointState start = near_truth(rows, NoiseLaw::f_squared);
  const MarginalFit fit = solve_with_serial_errors(rows.problem, serial, start, Held{});
  ASSERT_EQ(fit.outcome, Outcome::converged) << fit.reason;
  // With alpha held elsewhere, and sigma as found, the value is larger by half the information's square.
  Held held;
  held.alpha = held.sigmas = true;
  for (Eigen::Index j = 0; j < 3; ++j)
    for (const double side : {-1.0, 1.0}) {
      JointState away = fit.state;
      away.alpha[j] += side * 0.1 * std::sqrt((*fit.covariance)(j, j));
      EXPECT_GT(solve_with_serial_errors(rows.problem, serial, away, held).marginal_nll, fit.marginal_nll);
    }
}

TEST(SerialErrors, TheNLLIsTheSumOfItsParts) {
  const Recording recording = on_the_way(0.6, 0.9, 2, "SerialErrors.Parts", 0, 120);
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const Effect* effect = find_effect("autocorrelated_noise");
  ASSERT_EQ(effect->missing(rows.context), "");
  const Model model{{effect, Eigen::Vector3d(0.9, 0.0, 0.6)}};
  const JointState state = near_truth(rows, NoiseLaw::f_squared);
  const WorkingProblem working = working_problem(rows, model, state);
  Held held;
  held.alpha = held.sigmas = true;
  const double value =
      solve_with_serial_errors(working.problem, working.serial, state, held).marginal_nll + working.constant;
  Eigen::VectorXd e(120);
  double log_spread = 0.0;
  const CellGeometry geometry = cell_geometry(rows, state);
  for (int i = 0; i < 120; ++i) {
    e[i] = (rows.range_m[static_cast<std::size_t>(i)] - geometry.f[static_cast<std::size_t>(i)]) /
           geometry.spread[static_cast<std::size_t>(i)];
    log_spread += std::log(geometry.spread[static_cast<std::size_t>(i)]);
  }
  const Eigen::MatrixXd C = dense(rows.sequence, 0.6, 0.9);
  EXPECT_NEAR(
      value,
      log_spread + 0.5 * e.dot(C.ldlt().solve(e)) + 0.5 * std::log(C.determinant()) + 120 * half_log_two_pi,
      1e-8);
  EXPECT_NEAR(serial_nll(rows, working, state), 0.5 * (e.dot(C.ldlt().solve(e)) - e.squaredNorm()), 1e-9);
}

TEST(SerialErrors, ProjectionsAreThoseOfGeneralisedLeastSquares) {
  const Recording recording = on_the_way(0.6, 0.9, 0, "SerialErrors.Projector", 0, 80);
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const Model model{{find_effect("autocorrelated_noise"), Eigen::Vector3d(0.9, 0.0, 0.6)}};
  const JointState start = near_truth(rows, NoiseLaw::constant);
  const JointState state =
      solve_with_serial_errors(rows.problem, SerialErrors(rows.sequence, 0.6, 0.9), start, Held{}).state;
  const Projector projector(rows, working_problem(rows, model, state), state);
  const Eigen::Index n = 80;
  Eigen::MatrixXd X(n, 3);
  Signature shape;
  shape.range.resize(n);
  shape.bearing = Eigen::VectorXd::Zero(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double d = recording.pairs.true_m[static_cast<std::size_t>(i)];
    X.row(i) << 1.0, d, d * d;
    shape.range[i] = std::sin(5.0 * d);
  }
  const double variance = std::pow(state.noise.parameters[0], 2);
  const Eigen::MatrixXd W = dense(rows.sequence, 0.6, 0.9).inverse() / variance;
  const Eigen::MatrixXd P = W - W * X * (X.transpose() * W * X).inverse() * X.transpose() * W;
  const Eigen::VectorXd projected = projector.project(shape);
  EXPECT_LT((projected.head(n) - P * shape.range).norm(), 1e-6 * (P * shape.range).norm());
  EXPECT_NEAR(projector.inner(shape, projected, shape), shape.range.dot(P * shape.range),
              1e-6 * shape.range.dot(P * shape.range));
  Eigen::VectorXd y(n);
  for (Eigen::Index i = 0; i < n; ++i) y[i] = rows.range_m[static_cast<std::size_t>(i)];
  EXPECT_NEAR(projector.score(shape), shape.range.dot(P * y), 1e-5 * std::abs(shape.range.dot(P * y)) + 1e-6);
  const JointState away = near_truth(rows, NoiseLaw::constant);
  const Eigen::VectorXd gradient =
      -X.transpose() * (W * variance / std::pow(away.noise.parameters[0], 2)) * (y - X * away.alpha);
  EXPECT_LT((Projector(rows, working_problem(rows, model, away), away).alpha_gradient() - gradient).norm(),
            1e-9 * gradient.norm());
  EXPECT_LT((projector.unweighted(projector.weighted(shape.range)) - shape.range).norm(), 1e-9);
}

TEST(SerialErrors, AFitWithTailsCanBeRepeated) {
  Recording recording = on_the_way(0.6, 0.9, 2, "SerialErrors.Repeated", 0, 300);
  Random random(seed_from("SerialErrors.Repeated.echoes"));
  for (double& y : recording.pairs.reading_m)
    if (random.uniform() < 0.06) y -= 0.3 * random.uniform();
  const Rows rows = make_rows({&recording, 1}, {CurveScale{}, 2});
  const Model model{{find_effect("autocorrelated_noise"), Eigen::Vector3d(0.8, 0.0, 0.5)},
                    {find_effect("early_echo"), Eigen::Vector2d(0.05, 0.2)}};
  const Fit fit = refit(rows, model, near_truth(rows, NoiseLaw::f_squared), RefitOptions{});
  ASSERT_TRUE(fit.ok);
  JointState state = fit.state;
  EXPECT_NEAR(calibrate_under(rows, fit.model, state, RefitOptions{}), fit.nll, 0.05);
  EXPECT_NEAR(nll_at(rows, working_problem(rows, fit.model, fit.state), fit.state), fit.nll, 1e-6);
}

TEST(SerialErrors, NoiseThatWandersIsNamedAndNothingElse) {
  int named = 0, shares = 0;
  for (std::uint64_t seed = 0; seed < 10; ++seed) {
    const Diagnosis d = testing::verdict_of(on_the_way(0.7, 0.9, 2, "SerialErrors.Named", seed));
    if (d.final_effects != std::vector<std::string>{"autocorrelated_noise"}) {
      ADD_FAILURE() << seed << ": " << d.sentence;
      continue;
    }
    ++named;
    for (const EffectEstimate& e : d.explanations.at(0).parameters)
      shares += e.name == "autocorrelated_noise.share" && e.low95 < 0.7 && e.high95 > 0.7;
  }
  EXPECT_GE(named, 9);
  EXPECT_GE(shares, 7);  // of 10 at 95 %: fewer once in 1000 times
}

/// A sensor that warms up by 8 mm in 10 s, noise that wanders beside it.
TEST(SerialErrors, AnEffectBesideNoiseThatWandersKeepsItsName) {
  int both = 0;
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    Recording recording = on_the_way(0.6, 0.8, 0, "SerialErrors.Beside", seed, 800);
    std::vector<double> temperature;
    for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
      temperature.push_back(20.0 + 8.0 * std::sin(0.11 * static_cast<double>(i)));
      recording.pairs.reading_m[i] += 0.001 * (temperature.back() - 20.0);
    }
    recording.pairs.covariates["temperature_c"] = temperature;
    const Diagnosis d = testing::verdict_of(recording);
    both += d.final_effects.size() == 2;
    EXPECT_EQ(d.final_effects.size(), 2u) << seed << ": " << d.sentence;
  }
  EXPECT_GE(both, 7);
}

}  // namespace
}  // namespace rangecal::diagnosis
