// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/range_model.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <chrono>
#include <cmath>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

constexpr double range_noise_m = 0.01, stop_error_m = 0.01;

/// Five sights from each of `stops` stops along a line, whose errors they share.
std::vector<RangeSample> sights_of_stops(int stops) {
  Random random(seed_from("sights of stops"));
  std::vector<RangeSample> samples;
  for (int k = 0; k < stops; ++k) {
    const Eigen::Vector2d error(stop_error_m * random.normal(), stop_error_m * random.normal());
    for (int l = 0; l < 5; ++l) {
      RangeSample s;
      s.d = random.uniform(0.5, 5.0);
      const double angle = random.uniform(-3.0, 3.0);
      s.u = Eigen::Vector2d(std::cos(angle), std::sin(angle));
      s.y = 0.05 + 0.9 * (s.d - s.u.dot(error)) + range_noise_m * random.normal();
      s.d_variance = stop_error_m * stop_error_m;
      s.stop = k;
      s.landmark = l;
      samples.push_back(s);
    }
  }
  return samples;
}

/// std of sigma by the matrices of residual_spread.hpp written out, cells x cells; single readings, weights 1.
double spread_by_matrices(const std::vector<RangeSample>& samples,
                          const std::vector<Eigen::Matrix2d>& landmarks, const RangeModel& model) {
  const auto N = static_cast<Eigen::Index>(samples.size());
  const double sigma = model.noise.parameters[0];
  Eigen::MatrixXd H(N, model.alpha.size()), Omega = Eigen::MatrixXd::Zero(N, N);
  Eigen::VectorXd scale(N);
  for (Eigen::Index i = 0; i < N; ++i) {
    const RangeSample& a = samples[static_cast<std::size_t>(i)];
    H.row(i) = powers_of(a.d, model.alpha.size()).transpose();
    scale[i] = std::pow(model.noise.spread(a.d, evaluate_polynomial(model.alpha, a.d)) / sigma, 2);
    Omega(i, i) = sigma * sigma * scale[i];
    for (Eigen::Index j = 0; j < N; ++j) {
      const RangeSample& b = samples[static_cast<std::size_t>(j)];
      const double slopes = evaluate_derivative(model.alpha, a.d) * evaluate_derivative(model.alpha, b.d);
      if (a.stop == b.stop) Omega(i, j) += slopes * std::sqrt(a.d_variance * b.d_variance) * a.u.dot(b.u);
      if (!landmarks.empty() && a.landmark == b.landmark)
        Omega(i, j) += slopes * a.u.dot(landmarks[static_cast<std::size_t>(a.landmark)] * b.u);
    }
  }
  const Eigen::MatrixXd M =
      Eigen::MatrixXd::Identity(N, N) - H * (H.transpose() * H).inverse() * H.transpose();
  const Eigen::MatrixXd T = Omega.diagonal().cwiseInverse().asDiagonal() * (M * Omega * M.transpose());
  const double fall = (T.diagonal().array() * scale.array() / Omega.diagonal().array()).sum();
  return std::sqrt(2.0 * (T * T).trace()) / fall / (2.0 * sigma);
}

TEST(RangeModel, SightsOfOneStopShareItsError) {
  const std::vector<RangeSample> samples = sights_of_stops(12);
  ClosedFormOptions options;
  options.noise_law = NoiseLaw::constant;
  const RangeModel model = fit_range_model(samples, RangeWeighting::ordinary, {}, 1, options);
  ASSERT_EQ(model.outcome, Outcome::converged) << model.reason;
  ASSERT_TRUE(model.noise_estimates[0].std_dev);
  EXPECT_NEAR(*model.noise_estimates[0].std_dev, spread_by_matrices(samples, {}, model), 1e-10);
}

TEST(RangeModel, SightsOfOneLandmarkShareItsError) {
  // Weights 1 under noise of f^2, and landmarks of 1 to 3 cm: the curve's error and the landmarks' are in all near cells.
  std::vector<RangeSample> samples = sights_of_stops(12);
  Random random(seed_from("errors of landmarks"));
  std::vector<Eigen::Matrix2d> landmarks(5, Eigen::Matrix2d::Zero());  // the last is exact
  std::vector<Eigen::Vector2d> error(5, Eigen::Vector2d::Zero());
  for (std::size_t l = 0; l + 1 < landmarks.size(); ++l) {
    Eigen::Matrix2d root;
    root << 0.01 * random.normal(), 0.01 * random.normal(), 0.01 * random.normal(), 0.01;
    landmarks[l] = root * root.transpose();
    error[l] = root * Eigen::Vector2d(random.normal(), random.normal());
  }
  for (RangeSample& s : samples)
    s.y += 0.9 * s.u.dot(error[static_cast<std::size_t>(s.landmark)]) + 0.01 * s.d * s.d * random.normal();
  ClosedFormOptions options;
  options.noise_law = NoiseLaw::f_squared;
  const RangeModel model = fit_range_model(samples, RangeWeighting::ordinary, landmarks, 2, options);
  ASSERT_EQ(model.outcome, Outcome::converged) << model.reason;
  ASSERT_TRUE(model.noise_estimates[0].std_dev);
  const double expected = spread_by_matrices(samples, landmarks, model);
  EXPECT_NEAR(*model.noise_estimates[0].std_dev, expected, 1e-8 * expected);
}

TEST(RangeModel, ManySightsFromOneStopCostOnePass) {
  // Pairs are that. Pair by pair 200 000 of them would be 2e10 terms, some minutes; one pass takes a tenth of
  // a second.
  Random random(seed_from("many sights"));
  std::vector<RangeSample> samples(200000);
  for (RangeSample& s : samples) {
    s.d = random.uniform(0.5, 5.0);
    s.y = 0.05 + 0.9 * s.d + range_noise_m * random.normal();
  }
  ClosedFormOptions options;
  options.noise_law = NoiseLaw::constant;
  const auto begin = std::chrono::steady_clock::now();
  const RangeModel model = fit_range_model(samples, RangeWeighting::ordinary, {}, 1, options);
  EXPECT_LT(std::chrono::steady_clock::now() - begin, std::chrono::seconds(20));
  ASSERT_EQ(model.outcome, Outcome::converged) << model.reason;
  // sigma / sqrt(2 (N - 2)): nothing is shared where the distances are exact.
  const double sigma = model.noise.parameters[0];
  EXPECT_NEAR(*model.noise_estimates[0].std_dev, sigma / std::sqrt(2.0 * 199998.0), 1e-9 * sigma);
}

}  // namespace
}  // namespace rangecal
