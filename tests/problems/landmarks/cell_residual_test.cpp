// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/cell_residual.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <cmath>
#include <limits>

#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;
using testing::SceneOptions;

StopBlock block_of(const testing::JointScene& scene, int k, int size, int heading) {
  return {scene.truth.stops[k], size, true, heading};
}

/// Blocks of one residual at the truth, moved a little.
struct Blocks {
  Blocks(const CellResidual& residual, const CurveBlock& curve, const JointState& state) {
    const std::vector<int> sizes = residual.block_sizes();
    std::vector<double> shared(curve.alpha_count(), 0.02);
    shared.insert(shared.end(), state.noise.parameters.begin(), state.noise.parameters.end());
    if (state.noise.law != NoiseLaw::polynomial) shared.back() = std::log(shared.back());
    shared.push_back(std::log(state.sigma_theta_rad));
    const Eigen::Vector2d m = state.landmarks[residual.landmark()];
    values = {shared, std::vector<double>(sizes[1], 0.013), {m.x() + 0.01, m.y() - 0.02}};
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

class CellResidualTest : public ::testing::TestWithParam<NoiseLaw> {
 protected:
  void SetUp() override {
    SceneOptions o{.stops = 6, .landmarks = 3, .repeats = 4, .law = GetParam(), .sigma_heading = 0.02};
    o.places = o.turns = true;
    scene = make_scene("cell residual", o);
    if (GetParam() != NoiseLaw::constant) return;
    Cells& cells = scene.problem.cells;  // one of the laws with an effect's slope in every cell
    for (std::size_t i = 0; i < cells.size(); ++i) {
      cells.effect_slope.push_back(0.7 * std::cos(3.0 * static_cast<double>(i)));
      cells.effect_slope_at_m.push_back(cells.range_mean[i]);
    }
  }
  testing::JointScene scene;
};

TEST_P(CellResidualTest, JacobianMatchesDifferencesWithTheFloorHeld) {
  const CurveBlock curve(scene.truth, 0.1 * Eigen::Matrix3d::Identity());
  const int cell = scene.problem.cells.stop_begin[2] + 1;  // of the second stop of a place
  const CellResidual residual(scene.problem, curve, scene.truth, block_of(scene, 2, 4, 3), cell);
  Blocks blocks(residual, curve, scene.truth);
  const int n = residual.residual_count();
  ASSERT_EQ(n, 5);
  double floor = 0.0;
  ASSERT_TRUE(residual.log_spread(blocks.pointers().data(), floor));
  floor -= 0.5;
  std::vector<double> r(n, std::nan(""));
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
      ASSERT_TRUE(residual.evaluate(moved.pointers().data(), &floor, up.data(), nullptr));
      moved.values[b][e] -= 2 * h;
      ASSERT_TRUE(residual.evaluate(moved.pointers().data(), &floor, down.data(), nullptr));
      for (int i = 0; i < n; ++i) {
        const double analytic = jacobian[b][i * blocks.values[b].size() + e],
                     numeric = (up[i] - down[i]) / (2 * h);
        // Rounding 1e-16 r / h with r up to 1e2, and the third derivative times h^2.
        EXPECT_NEAR(analytic, numeric, 1e-6 * (1.0 + std::abs(numeric)))
            << "row " << i << " block " << b << " " << e;
      }
    }
}

TEST_P(CellResidualTest, HalfTheSumOfSquaresOfCellsAndPriorIsTheLikelihoodWhereverTheFloorsAre) {
  const CurveBlock curve(scene.truth, Eigen::Matrix3d::Identity());
  const Cells& c = scene.problem.cells;
  const int k = 3;
  const StopBlock stop = block_of(scene, k, 3, 2);
  const double curve_step[2] = {0.01, 0.001}, stop_step[3] = {0.033, 0.013, 0.013};  // from the truth
  JointState state_a = scene.truth, state_b = scene.truth;
  double change = 0.0;
  for (int cell = c.stop_begin[k]; cell < c.stop_begin[k + 1]; ++cell) {
    const CellResidual residual(scene.problem, curve, scene.truth, stop, cell);
    Blocks a(residual, curve, scene.truth), b = a;
    b.values[0][1] += curve_step[0];
    b.values[0][3] += curve_step[1];
    b.values[1] = {stop_step[0], stop_step[1], stop_step[2]};
    std::vector<double> at_a(residual.residual_count()), at_b(at_a), held(at_a);
    double floor = 0.0;
    ASSERT_TRUE(residual.evaluate(a.pointers().data(), nullptr, at_a.data(), nullptr));
    ASSERT_TRUE(residual.evaluate(b.pointers().data(), nullptr, at_b.data(), nullptr));
    ASSERT_TRUE(residual.log_spread(a.pointers().data(), floor));
    floor -= 1.0;
    ASSERT_TRUE(residual.evaluate(b.pointers().data(), &floor, held.data(), nullptr));
    EXPECT_NEAR(half_square(held), half_square(at_b), 1e-10);
    change += half_square(at_b) - half_square(at_a);
    for (auto [blocks, state] : {std::pair{&a, &state_a}, {&b, &state_b}}) {
      for (int i = 0; i < 3; ++i) state->alpha[i] = scene.truth.alpha[i] + blocks->values[0][i];
      const bool polynomial = GetParam() == NoiseLaw::polynomial;
      for (Eigen::Index i = 0; i < state->noise.parameters.size(); ++i)
        state->noise.parameters[i] =
            polynomial ? blocks->values[0][3 + i] : std::exp(blocks->values[0][3 + i]);
      state->stops[k] = stop.pose(blocks->values[1].data());
      state->landmarks[residual.landmark()] = Eigen::Vector2d(blocks->values[2][0], blocks->values[2][1]);
    }
    if (cell > c.stop_begin[k]) continue;
    const StopPriorResidual prior(scene.problem.stops[k], sigma_xy_of(scene.problem, scene.truth, k), stop);
    std::vector<double> prior_a(prior.residual_count()), prior_b(prior_a);
    ASSERT_EQ(prior_a.size(), scene.problem.stops[k].opens_place ? 3u : 1u);
    prior.evaluate(a.values[1].data(), prior_a.data(), nullptr);
    prior.evaluate(b.values[1].data(), prior_b.data(), nullptr);
    change += half_square(prior_b) - half_square(prior_a);
  }
  // Only the readings of that stop: the others are taken out of the problem.
  JointProblem one = scene.problem;
  for (std::size_t i = 0; i < one.cells.size(); ++i)
    if (one.cells.stop[i] != k)
      one.cells.count[i] = one.cells.range_weight[i] = one.cells.bearing_weight[i] = 0.0;
  const double expected = joint_nll(one, state_b) - joint_nll(one, state_a);
  EXPECT_NEAR(change, expected, 1e-9 * (1.0 + std::abs(expected)));
}

TEST_P(CellResidualTest, RefusesBelowTheFloorAndOutsideOfTheDomain) {
  const CurveBlock curve(scene.truth, Eigen::Matrix3d::Identity());
  const CellResidual residual(scene.problem, curve, scene.truth, block_of(scene, 0, 3, 2), 0);
  Blocks blocks(residual, curve, scene.truth);
  std::vector<double> r(residual.residual_count());
  double floor = 0.0;
  ASSERT_TRUE(residual.log_spread(blocks.pointers().data(), floor));
  floor += 1e-9;
  EXPECT_FALSE(residual.evaluate(blocks.pointers().data(), &floor, r.data(), nullptr));
  blocks.values[1][0] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_FALSE(residual.evaluate(blocks.pointers().data(), nullptr, r.data(), nullptr));
}

TEST(StopPriorResidual, HandWorkedValuesAndJacobian) {
  // 0.04 m and -0.02 m off at sigma 0.02 m: 2, -1; 0.03 rad off at sigma 0.01: 3.
  StopPrior prior;
  prior.commanded = {1.0, 2.0, 0.5};
  prior.sigma_heading_rad = 0.01;
  const StopPriorResidual residual(prior, 0.02, {prior.commanded, 4, true, 3});
  ASSERT_EQ(residual.residual_count(), 3);
  const double own[4] = {0.04, -0.02, 9.0, 0.03};
  double r[3], jacobian[12];
  residual.evaluate(own, r, jacobian);
  const double expected[3] = {2.0, -1.0, 3.0};
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(r[i], expected[i], 1e-12);
    for (int j = 0; j < 4; ++j)
      EXPECT_NEAR(jacobian[4 * i + j], i < 2 && i == j ? 50.0 : i == 2 && j == 3 ? 100.0 : 0.0, 1e-9);
  }
  // Correlated errors: half the square of the residuals is e^T C^-1 e / 2, and their Jacobian is that of R e.
  Eigen::Matrix3d Q;
  Q << 1.5, 0.3, 0.4, 0.3, 0.5, -0.35, 0.4, -0.35, 1.0;
  prior.shape = std::make_shared<const Eigen::Matrix3d>(Q);
  const StopPriorResidual shaped(prior, 0.02, {prior.commanded, 4, true, 3});
  ASSERT_EQ(shaped.residual_count(), 3);
  shaped.evaluate(own, r, jacobian);
  const Eigen::Vector3d z(2.0, -1.0, 3.0);  // e over its sigmas, as above
  EXPECT_NEAR(r[0] * r[0] + r[1] * r[1] + r[2] * r[2], z.dot(Q.inverse() * z), 1e-9);
  for (int j = 0; j < 4; ++j) {
    double moved[4] = {own[0], own[1], own[2], own[3]}, up[3];
    moved[j] += 1.0;  // linear: one step is the derivative
    shaped.evaluate(moved, up, nullptr);
    for (int i = 0; i < 3; ++i) EXPECT_NEAR(jacobian[4 * i + j], up[i] - r[i], 1e-9) << i << j;
  }
  prior.chained = true;
  EXPECT_EQ(StopPriorResidual(prior, 0.02, {prior.commanded, 4, true, 3}).residual_count(), 0);
}

INSTANTIATE_TEST_SUITE_P(Laws, CellResidualTest,
                         ::testing::Values(NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared,
                                           NoiseLaw::f_cubed, NoiseLaw::d_squared, NoiseLaw::polynomial));

TEST(CellResidual, HandWorkedValues) {
  // One stop at the origin, exact, one landmark at (2, 0) of radius 0: d = 2, f = 0.1 + d = 2.1, s = 0.5.
  // y = 2.2, R = 4, S^2 = 0.25: sqrt(4) 0.1 / 0.5 = 0.4; floor at s: sqrt(2 4 0.5) = 2; S: 2 0.5 / 0.5 = 2.
  // b = 0.03, theta = 0, sigma_theta = 0.01, V = 4: 2 0.03 / 0.01 = 6.
  // Level: sqrt(2 4 (3 - 0.5)) = sqrt(20).
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
  const CurveBlock curve(state, Eigen::Matrix2d::Identity());
  const CellResidual residual(problem, curve, state, {}, 0);
  const double shared[4] = {0, 0, std::log(0.5), std::log(0.01)}, m[2] = {2, 0};
  const double* blocks[] = {shared, m};
  ASSERT_EQ(residual.residual_count(), 5);
  double r[5];
  ASSERT_TRUE(residual.evaluate(blocks, nullptr, r, nullptr));
  EXPECT_NEAR(r[0], 0.4, 1e-12);
  EXPECT_NEAR(r[1], 2.0, 1e-12);
  EXPECT_NEAR(r[2], 6.0, 1e-12);
  EXPECT_NEAR(r[3], std::sqrt(20.0), 1e-12);
  EXPECT_NEAR(r[4], 2.0, 1e-12);
}

TEST(BearingSpreadResidual, HandWorkedValuesAndJacobian) {
  // N = 8, sum V S^2 = 0.04, sigma = 0.1 = reference: 0.2 / 0.1 = 2; sqrt(2 8 0.5) = sqrt(8); sqrt(2 8 2.5) =
  // sqrt(40).
  const BearingSpreadResidual residual{
      .readings = 8, .square_sum = 0.04, .log_reference = std::log(0.1), .index = 1, .block_size = 2};
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
