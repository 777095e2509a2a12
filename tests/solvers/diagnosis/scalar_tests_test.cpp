// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/scalar_tests.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "diagnosis/battery.hpp"
#include "statistics/kurtosis_law.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

double central_moment(const std::vector<double>& values, int power) {
  double mean = 0.0, sum = 0.0;
  for (double x : values) mean += x / static_cast<double>(values.size());
  for (double x : values) sum += std::pow(x - mean, power);
  return sum / static_cast<double>(values.size());
}

TEST(ScalarTests, SkewnessAsSciPyHasIt) {
  // scipy.stats.skewtest([2, 8, 0, 4, 1, 9, 9, 0]) of SciPy's reference: statistic 0.44626385374196975
  const std::vector<double> values = {2, 8, 0, 4, 1, 9, 9, 0};
  const double skewness = central_moment(values, 3) / std::pow(central_moment(values, 2), 1.5);
  EXPECT_NEAR(skewness_z(skewness, 8.0), 0.44626385374196975, 1e-12);
  EXPECT_DOUBLE_EQ(skewness_z(-skewness, 8.0), -skewness_z(skewness, 8.0));
}

TEST(ScalarTests, TwoValuedResidualsHaveLightTails) {
  // 24 cells of three readings above and three below by the same: 144 deviations of one size, a kurtosis of 1. Anscombe and
  // Glynn's cube root gives +30 there, the law of the kurtosis -13.
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  testing::add_landmarks(recording, 4);
  JointState state;
  state.alpha = Eigen::Vector2d(0.0, 1.0);
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters = Eigen::VectorXd::Constant(1, 0.01);
  state.sigma_theta_rad = 0.01;
  state.landmarks = {{0.5, 1.3}, {1.0, -1.7}, {2.1, 0.8}, {-0.7, 0.4}};
  for (int k = 0; k < 6; ++k) {
    testing::add_stop(recording, {0.2 * k, 0.03 * k * k, 0.0}, 0.01);
    state.stops.push_back(recording.stops.back().commanded);
    for (int l = 0; l < 4; ++l)
      for (int j = 0; j < 6; ++j) {
        const Eigen::Vector2d way = state.landmarks[static_cast<std::size_t>(l)] -
                                    Eigen::Vector2d(state.stops.back().x_m, state.stops.back().y_m);
        const double error = j % 2 == 0 ? 0.01 : -0.01;
        testing::add_reading(recording, k, l, j, way.norm() + error, std::atan2(way.y(), way.x()) + error);
      }
  }
  const Rows rows = make_rows({&recording, 1});
  int asked = 0;
  for (const Question& q : Battery(rows, {}, state).questions) {
    if (!q.z || q.shape != "heavy tails") continue;
    ++asked;
    EXPECT_NEAR(*q.z, kurtosis_score(1.0, 144.0), 1e-6) << q.channel;
    EXPECT_LT(*q.z, -12.0) << q.channel;
    EXPECT_GT(*q.z, -14.0) << q.channel;
    EXPECT_NEAR(q.size, -2.0, 1e-9) << q.channel;
  }
  EXPECT_EQ(asked, 2);
}

}  // namespace
}  // namespace rangecal::diagnosis
