// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/reference_error.hpp"

#include <gtest/gtest.h>

#include <string>

#include "rangecal/core/random.hpp"
#include "rangecal/solvers/calibrate.hpp"

namespace rangecal {
namespace {

/// 12 distances, 25 readings at each with a noise of 2 mm, f = 0.02 + 1.01 d; each stated distance is off by its own error of
/// `reference_m`.
Recording taped(double reference_m, const std::string& name, std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  recording.reference.sigma_m = reference_m;
  Random random(seed_from(name, {seed}));
  for (int s = 0; s < 12; ++s) {
    const double stated = 0.5 + 0.3 * s, d = stated + reference_m * random.normal();
    for (int i = 0; i < 25; ++i) {
      recording.pairs.true_m.push_back(stated);
      recording.pairs.reading_m.push_back(0.02 + 1.01 * d + 0.002 * random.normal());
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
    }
  }
  return recording;
}

Calibration line_of(const Recording& recording) {
  CalibrateOptions options;
  options.methods = {Method::full};
  options.order = 1;
  options.noise = NoiseLaw::constant;
  options.noise_shape = NoiseShape::gaussian;
  return calibrate_report(std::span(&recording, 1), options).calibrations.front();
}

TEST(ReferenceError, TheCovarianceIsThatOfSamples) {
  // 400 recordings: (alpha - true)^T C^-1 (alpha - true), summed, is chi-square with 800 degrees of freedom where C is
  // right to first order; its mean per degree has a standard deviation of sqrt(2 / 800) = 0.05.
  const Eigen::Vector2d truth(0.02, 1.01);
  double with = 0.0, without = 0.0;
  for (std::uint64_t seed = 0; seed < 400; ++seed) {
    Recording recording = taped(0.005, "ReferenceError.Samples", seed);
    const Calibration stated = line_of(recording);
    recording.reference.sigma_m = 0.0;
    const Calibration silent = line_of(recording);
    ASSERT_TRUE(stated.alpha_covariance && silent.alpha_covariance);
    EXPECT_EQ(stated.alpha, silent.alpha);
    const Eigen::Vector2d off = stated.alpha - truth;
    with += off.dot(stated.alpha_covariance->ldlt().solve(off)) / 800.0;
    without += off.dot(silent.alpha_covariance->ldlt().solve(off)) / 800.0;
  }
  EXPECT_NEAR(with, 1.0, 0.2);  // four deviations
  EXPECT_GT(without, 10.0);     // of 25 readings with one error
}

TEST(ReferenceError, DistancesOfTheirOwnAddNothing) {
  Recording recording = taped(0.005, "ReferenceError.Own", 1);
  for (std::size_t i = 0; i < recording.pairs.size(); ++i)
    recording.pairs.true_m[i] += 1e-9 * static_cast<double>(i);
  Calibration calibration = line_of(recording);
  const Eigen::MatrixXd before = *calibration.alpha_covariance;
  EXPECT_TRUE(add_reference_error(std::span(&recording, 1), calibration));
  EXPECT_LT((*calibration.alpha_covariance - before).norm(), 1e-12 * before.norm());
}

TEST(ReferenceError, ExactDistancesSayNothing) {
  const Recording recording = taped(0.0, "ReferenceError.Exact", 1);
  Calibration calibration = line_of(recording);
  EXPECT_FALSE(add_reference_error(std::span(&recording, 1), calibration));
}

}  // namespace
}  // namespace rangecal
