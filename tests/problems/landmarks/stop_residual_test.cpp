// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/stop_residual.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;
using testing::SceneOptions;

/// Blocks of one residual at the truth, moved a little.
struct Blocks {
  Blocks(const StopResidual& residual, const JointState& state) {
    const std::vector<int> sizes = residual.block_sizes();
    values.push_back(std::vector<double>(sizes[0], 0.02));
    std::vector<double> sigmas(state.noise.parameters.begin(), state.noise.parameters.end());
    if (state.noise.law != NoiseLaw::polynomial) sigmas[0] = std::log(sigmas[0]);
    sigmas.push_back(std::log(state.sigma_theta_rad));
    values.push_back(sigmas);
    if (residual.coordinates() > 0) values.push_back(std::vector<double>(residual.coordinates(), 0.013));
    for (int l : residual.landmarks()) values.push_back({state.landmarks[l].x() + 0.01, state.landmarks[l].y() - 0.02});
  }
  std::vector<const double*> pointers() const {
    std::vector<const double*> p;
    for (const auto& block : values) p.push_back(block.data());
    return p;
  }
  std::vector<std::vector<double>> values;
};

double half_square(const std::vector<double>& r) {
  double sum = 0.0;
  for (double e : r) sum += 0.5 * e * e;
  return sum;
}

class StopResidualTest : public ::testing::TestWithParam<NoiseLaw> {
 protected:
  void SetUp() override {
    SceneOptions o{.stops = 6, .landmarks = 3, .repeats = 4, .law = GetParam(), .sigma_heading = 0.02};
    o.places = o.turns = true;
    scene = make_scene("stop residual", o);
    if (GetParam() != NoiseLaw::constant) return;
    Cells& cells = scene.problem.cells;  // one of the laws with an effect's slope in every cell
    for (std::size_t i = 0; i < cells.size(); ++i) {
      cells.bend.push_back(0.7 * std::cos(3.0 * static_cast<double>(i)));
      cells.bend_at_m.push_back(cells.range_mean[i]);
    }
  }
  testing::Scene scene;
};

TEST_P(StopResidualTest, JacobianMatchesDifferencesWithTheFloorsHeld) {
  const StopResidual residual(scene.problem, scene.truth, 0.1 * Eigen::Matrix3d::Identity(), {1, 2});  // one place
  Blocks blocks(residual, scene.truth);
  const int n = residual.residual_count();
  std::vector<double> floor(residual.cell_count()), r(n, std::nan(""));
  ASSERT_TRUE(residual.log_spreads(blocks.pointers().data(), floor.data()));
  for (double& value : floor) value -= 0.5;
  std::vector<std::vector<double>> jacobian;
  std::vector<double*> pointers;
  for (int size : residual.block_sizes()) jacobian.emplace_back(n * size, std::nan(""));
  for (auto& j : jacobian) pointers.push_back(j.data());
  ASSERT_TRUE(residual.evaluate(blocks.pointers().data(), nullptr, r.data(), pointers.data()));
  for (double value : r) EXPECT_TRUE(std::isfinite(value));
  for (std::size_t b = 0; b < jacobian.size(); ++b)
    for (std::size_t e = 0; e < blocks.values[b].size(); ++e) {
      const double h = 1e-6;
      std::vector<double> up(n), down(n);
      Blocks moved = blocks;
      moved.values[b][e] += h;
      ASSERT_TRUE(residual.evaluate(moved.pointers().data(), floor.data(), up.data(), nullptr));
      moved.values[b][e] -= 2 * h;
      ASSERT_TRUE(residual.evaluate(moved.pointers().data(), floor.data(), down.data(), nullptr));
      for (int i = 0; i < n; ++i) {
        const double analytic = jacobian[b][i * blocks.values[b].size() + e], numeric = (up[i] - down[i]) / (2 * h);
        // Rounding 1e-16 r / h with r up to 1e2, and the third derivative times h^2.
        EXPECT_NEAR(analytic, numeric, 1e-6 * (1.0 + std::abs(numeric))) << "row " << i << " block " << b << " " << e;
      }
    }
}

TEST_P(StopResidualTest, HalfTheSumOfSquaresIsTheLikelihoodWhereverTheFloorsAre) {
  const StopResidual residual(scene.problem, scene.truth, Eigen::Matrix3d::Identity(), {3});
  Blocks a(residual, scene.truth), b = a;
  b.values[0][1] += 0.01;
  b.values[1][0] += 0.001;
  b.values[2][0] += 0.02;
  std::vector<double> at_a(residual.residual_count()), at_b(at_a), held(at_a), floor(residual.cell_count());
  ASSERT_TRUE(residual.evaluate(a.pointers().data(), nullptr, at_a.data(), nullptr));
  ASSERT_TRUE(residual.evaluate(b.pointers().data(), nullptr, at_b.data(), nullptr));
  ASSERT_TRUE(residual.log_spreads(a.pointers().data(), floor.data()));
  for (double& value : floor) value -= 1.0;
  ASSERT_TRUE(residual.evaluate(b.pointers().data(), floor.data(), held.data(), nullptr));
  EXPECT_NEAR(half_square(held), half_square(at_b), 1e-10);

  const auto state_at = [&](const Blocks& blocks) {
    JointState state = scene.truth;
    for (int i = 0; i < 3; ++i) state.alpha[i] += blocks.values[0][i];
    const bool polynomial = GetParam() == NoiseLaw::polynomial;
    for (Eigen::Index i = 0; i < state.noise.parameters.size(); ++i)
      state.noise.parameters[i] = polynomial ? blocks.values[1][i] : std::exp(blocks.values[1][i]);
    state.stops[3].x_m += blocks.values[2][0];
    state.stops[3].y_m += blocks.values[2][1];
    state.stops[3].heading_rad += blocks.values[2][2];
    for (std::size_t l = 0; l < residual.landmarks().size(); ++l)
      state.landmarks[residual.landmarks()[l]] = Eigen::Vector2d(blocks.values[3 + l][0], blocks.values[3 + l][1]);
    return state;
  };
  // Only the readings of stop 3: the others are taken out of the problem.
  JointProblem one = scene.problem;
  for (std::size_t i = 0; i < one.cells.size(); ++i)
    if (one.cells.stop[i] != 3) one.cells.count[i] = one.cells.range_weight[i] = one.cells.bearing_weight[i] = 0.0;
  const double expected = joint_nll(one, state_at(b)) - joint_nll(one, state_at(a));
  EXPECT_NEAR(half_square(at_b) - half_square(at_a), expected, 1e-9 * (1.0 + std::abs(expected)));
}

TEST_P(StopResidualTest, RefusesBelowTheFloorAndOutsideOfTheDomain) {
  const StopResidual residual(scene.problem, scene.truth, Eigen::Matrix3d::Identity(), {0});
  Blocks blocks(residual, scene.truth);
  std::vector<double> r(residual.residual_count()), floor(residual.cell_count());
  ASSERT_TRUE(residual.log_spreads(blocks.pointers().data(), floor.data()));
  floor[0] += 1e-9;
  EXPECT_FALSE(residual.evaluate(blocks.pointers().data(), floor.data(), r.data(), nullptr));
  blocks.values[2][0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(residual.evaluate(blocks.pointers().data(), nullptr, r.data(), nullptr));
}

INSTANTIATE_TEST_SUITE_P(Laws, StopResidualTest,
                         ::testing::Values(NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed,
                                           NoiseLaw::d_squared, NoiseLaw::polynomial));

TEST(StopResidual, HandWorkedValues) {
  // One stop at the origin, exact, one landmark at (2, 0) of radius 0: d = 2, f = 0.1 + d = 2.1, s = 0.5.
  // y = 2.2, R = 4, S^2 = 0.25: sqrt(4) 0.1 / 0.5 = 0.4; floor at s: sqrt(2 4 0.5) = 2; S: 2 0.5 / 0.5 = 2.
  // b = 0.03, theta = 0, sigma_theta = 0.01, V = 4: 2 0.03 / 0.01 = 6. Level: sqrt(2 4 (3 - 0.5)) = sqrt(20).
  JointProblem problem;
  problem.stops.push_back({});
  problem.place_count = 1;
  problem.sigma_s_shared = {0};
  problem.landmark_radius_m = {0.0};
  Cells& c = problem.cells;
  c.stop = c.landmark = {0};
  c.count = c.range_weight = c.bearing_weight = {4.0};
  c.range_mean = {2.2};
  c.range_mean_square = {0.25};
  c.bearing_mean = {0.03};
  c.bearing_mean_square = {0.0};
  c.radius_m = {0.0};
  c.stop_begin = {0, 1};
  JointState state;
  state.alpha = Eigen::Vector2d(0.1, 1.0);
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters = Eigen::VectorXd::Constant(1, 0.5);
  state.sigma_theta_rad = 0.01;
  state.stops = {{}};
  state.landmarks = {{2.0, 0.0}};
  const StopResidual residual(problem, state, Eigen::Matrix2d::Identity(), {0});
  const double u[2] = {0, 0}, sigmas[2] = {std::log(0.5), std::log(0.01)}, m[2] = {2, 0};
  const double* blocks[] = {u, sigmas, m};
  ASSERT_EQ(residual.residual_count(), 5);
  double r[5];
  ASSERT_TRUE(residual.evaluate(blocks, nullptr, r, nullptr));
  EXPECT_NEAR(r[0], 0.4, 1e-12);
  EXPECT_NEAR(r[1], 2.0, 1e-12);
  EXPECT_NEAR(r[2], 6.0, 1e-12);
  EXPECT_NEAR(r[3], 2.0, 1e-12);
  EXPECT_NEAR(r[4], std::sqrt(20.0), 1e-12);
}

TEST(BearingSpreadResidual, HandWorkedValuesAndJacobian) {
  // N = 8, sum V S^2 = 0.04, sigma = 0.1 = reference: 0.2 / 0.1 = 2; sqrt(2 8 0.5) = sqrt(8); sqrt(2 8 2.5) = sqrt(40).
  const BearingSpreadResidual residual{.readings = 8, .square_sum = 0.04, .log_reference = std::log(0.1), .index = 1, .block_size = 2};
  const double sigmas[2] = {7.0, std::log(0.1)}, floor = std::log(0.1) - 0.5;
  double r[3], up[3], down[3], jacobian[6];
  std::fill_n(jacobian, 6, std::nan(""));
  ASSERT_TRUE(residual.evaluate(sigmas, nullptr, r, jacobian));
  EXPECT_NEAR(r[0], 2.0, 1e-12);
  EXPECT_NEAR(r[1], std::sqrt(8.0), 1e-12);
  EXPECT_NEAR(r[2], std::sqrt(40.0), 1e-12);
  const double above[2] = {7.0, sigmas[1] + 1e-6}, below[2] = {7.0, sigmas[1] - 1e-6};
  residual.evaluate(above, &floor, up, nullptr);
  residual.evaluate(below, &floor, down, nullptr);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(jacobian[2 * i], 0.0);
    EXPECT_NEAR(jacobian[2 * i + 1], (up[i] - down[i]) / 2e-6, 1e-7);
  }
}

}  // namespace
}  // namespace rangecal
