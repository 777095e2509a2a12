// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/whitening.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/add_reading.hpp"

namespace rangecal {
namespace {

using diagnosis::CellsAndRows;
using diagnosis::Rows;
using diagnosis::Whitening;

/// Two stops, one landmark, `first` and `second` repeats.
Rows two_cells(int first, int second) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  testing::add_landmarks(recording, 1);
  for (int k = 0; k < 2; ++k) {
    testing::add_stop(recording, {0.5 * k, 0.0, 0.0}, 0.01, 0.0);
    for (int j = 0; j < (k == 0 ? first : second); ++j) testing::add_reading(recording, k, 0, j, 2.0, 0.1);
  }
  return diagnosis::make_rows({&recording, 1});
}

TEST(Whitening, HandWorkedWeights) {
  // Variances 1, 4 and 1/4: weights 1, 1/4 and 4. Mean of 1, 2, 3: (1 + 1/2 + 12) / (21/4) = 18/7.
  const Rows rows = two_cells(3, 1);
  const Whitening whitening{Eigen::Vector4d(1.0, 0.5, 2.0, 1.0), 0.0};
  const CellsAndRows parts = split(rows, Eigen::Vector4d(1.0, 2.0, 3.0, 7.0), whitening);
  EXPECT_NEAR(parts.means[0], 18.0 / 7.0, 1e-14);
  EXPECT_NEAR(parts.weights[0], 21.0 / 4.0, 1e-14);
  EXPECT_NEAR(parts.deviations[0], 1.0 - 18.0 / 7.0, 1e-14);
  EXPECT_NEAR(parts.deviations[1], 0.5 * (2.0 - 18.0 / 7.0), 1e-14);
  EXPECT_NEAR(parts.deviations[2], 2.0 * (3.0 - 18.0 / 7.0), 1e-14);
  EXPECT_EQ(parts.means[1], 7.0);
  EXPECT_EQ(parts.deviations[3], 0.0);
  EXPECT_NEAR(whitening.log_jacobian(rows), 0.0, 1e-14);  // -ln(1 * 1/2 * 2 * 1)
}

TEST(Whitening, IsTheInverseOfTheCovariance) {
  // y = mean + deviation in the metric of Sigma^-1, Sigma_ij = sqrt(m_i m_j) rho^|i-j|, solved as it stands.
  const Rows rows = two_cells(6, 2);
  Random random(seed_from("Whitening.IsTheInverseOfTheCovariance", {1}));
  Eigen::VectorXd m(8), x(8), y(8);
  for (int i = 0; i < 8; ++i) {
    m[i] = random.uniform(0.2, 5.0);
    x[i] = random.normal();
    y[i] = random.normal();
  }
  const Whitening whitening{m.cwiseSqrt().cwiseInverse(), -0.6};
  const CellsAndRows of_x = split(rows, x, whitening), of_y = split(rows, y, whitening);
  double log_det = 0.0;
  for (int c = 0; c < rows.cell_count; ++c) {
    const int begin = rows.cell_begin[c], n = rows.cell_begin[c + 1] - begin;
    Eigen::MatrixXd covariance(n, n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j)
        covariance(i, j) = std::sqrt(m[begin + i] * m[begin + j]) * std::pow(-0.6, std::abs(i - j));
    const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
    const double direct = x.segment(begin, n).dot(factor.solve(y.segment(begin, n)));
    EXPECT_NEAR(of_x.means[c] * of_x.weights[c] * of_y.means[c] +
                    of_x.deviations.segment(begin, n).dot(of_y.deviations.segment(begin, n)),
                direct, 1e-12);
    log_det += factor.matrixLLT().diagonal().array().log().sum();
  }
  EXPECT_NEAR(whitening.log_jacobian(rows), log_det, 1e-12);
}

/// Twelve stops, six landmarks, twenty sweeps with their times; a share of the ranges six times as noisy.
Recording long_stops_with_outliers(std::uint64_t seed, double share) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  Random random(seed_from("Whitening.long_stops_with_outliers", {seed}));
  const std::vector<Eigen::Vector2d> posts{{1.0, 1.6}, {2.5, -1.2}, {0.2, -0.9},
                                           {3.2, 1.1}, {-0.8, 0.7}, {1.7, 0.6}};
  testing::add_landmarks(recording, posts.size());
  for (int k = 0; k < 12; ++k) {
    const double t = k / 11.0;
    const Pose2 meant{2.6 * t, 0.25 * std::sin(5.0 * t), 0.7 * std::sin(4.0 * t)};
    testing::add_stop(recording, meant, 0.01, 0.0);
    const Eigen::Vector2d at(meant.x_m + random.normal(0.0, 0.01), meant.y_m + random.normal(0.0, 0.01));
    for (int j = 0; j < 20; ++j)
      for (std::size_t l = 0; l < posts.size(); ++l) {
        const Eigen::Vector2d v = posts[l] - at;
        const double f = 0.02 + 1.01 * v.norm();
        const double wild = random.uniform() < share ? 6.0 : 1.0;
        testing::add_reading(
            recording, k, static_cast<int>(l), j, f + 0.006 * f * f * wild * random.normal(),
            std::remainder(std::atan2(v.y(), v.x()) - meant.heading_rad + random.normal(0.0, 0.004),
                           2.0 * M_PI));
      }
  }
  return recording;
}

TEST(Whitening, OutliersWithinCellsAreTailsAndNothingElse) {
  // Without the weights of their law, outliers pass for what changes from sweep to sweep.
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const std::vector<Recording> recordings{long_stops_with_outliers(seed, 0.15)};
    const Diagnosis d = diagnose(recordings, {});
    EXPECT_EQ(d.final_effects, std::vector<std::string>{"heavy_tails"}) << seed << ": " << d.sentence;
  }
}

}  // namespace
}  // namespace rangecal
