// SPDX-License-Identifier: BSD-3-Clause
// Derivatives of the joint likelihood and of Laplace's log-determinant against central differences.
#include "rangecal/solvers/joint_ml/joint_system.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>

#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

using testing::make_scene;
using testing::SceneOptions;

struct SystemCase {
  const char* name;
  SceneOptions options;
  bool sigma_s_free = false;
  bool bent = false;
};

std::vector<SystemCase> system_cases() {
  testing::SceneVariants s({.stops = 6, .landmarks = 4});
  s.repeats.law = NoiseLaw::f;
  std::vector<SystemCase> all = s.cases<SystemCase>();
  all.push_back({"sigma_s", s.headings, true});
  all.push_back({"walk_sigma_s", s.walk_headings, true});
  all.push_back({"bent", s.walk_headings, false, true});
  all.push_back({"bent_repeats", s.repeats, false, true});
  all.push_back({"bent_polynomial", s.polynomial, false, true});
  return all;
}

class JointSystemTest : public ::testing::TestWithParam<SystemCase> {
 protected:
  void SetUp() override {
    scene = make_scene(GetParam().name, GetParam().options);
    state = scene.truth;
    // Away from the truth and from the optimum, so that every term counts.
    for (auto& landmark : state.landmarks) landmark += Eigen::Vector2d(0.02, -0.01);
    state.alpha += Eigen::Vector3d(0.01, -0.02, 0.003);
    if (GetParam().sigma_s_free) {
      scene.problem.estimate_sigma_s = true;
      scene.problem.sigma_s_shared.assign(scene.problem.stops.size(), 1);
      state.sigma_s_m = 0.015;
    }
    if (GetParam()
            .bent) {  // an effect's slope of up to 0.8 in every cell, about a distance a little beside its own
      Cells& cells = scene.problem.cells;
      for (std::size_t i = 0; i < cells.size(); ++i) {
        const Pose2& pose = state.stops[cells.stop[i]];
        const double d = (state.landmarks[cells.landmark[i]] - Eigen::Vector2d(pose.x_m, pose.y_m)).norm() -
                         cells.radius_m[i];
        cells.effect_slope.push_back(0.8 * std::sin(7.0 * d));
        cells.effect_slope_at_m.push_back(d + 0.01 * std::cos(3.0 * d));
      }
    }
  }
  JointSystem make_system() const {
    return JointSystem(scene.problem, 3, static_cast<int>(state.noise.parameters.size()),
                       GetParam().sigma_s_free);
  }
  /// The state moved along coordinate i of (globals, stops).
  JointState moved(const JointLayout& layout, int i, double step) const {
    Eigen::VectorXd globals = Eigen::VectorXd::Zero(layout.global_count);
    Eigen::VectorXd stops = Eigen::VectorXd::Zero(layout.coordinates);
    (i < layout.global_count ? globals[i] : stops[i - layout.global_count]) = step;
    return step_state(scene.problem, layout, state, globals, stops);
  }
  /// Moves the stops of `state` to their optimum given the rest, and eliminates them from the system there.
  void settle(JointSystem& system) {
    const LaplaceValue home = laplace_marginal(scene.problem, state);
    ASSERT_TRUE(home.ok);
    state = home.state;
    system.assemble(state, HessianKind::exact);
    ASSERT_TRUE(system.eliminate());
  }
  testing::JointScene scene;
  JointState state;
};

TEST_P(JointSystemTest, ValueIsTheJointNll) {
  JointSystem system = make_system();
  EXPECT_NEAR(system.assemble(state, HessianKind::exact), joint_nll(scene.problem, state), 1e-9);
}

TEST_P(JointSystemTest, GradientMatchesDifferences) {
  JointSystem system = make_system();
  const JointLayout& layout = system.layout();
  system.assemble(state, HessianKind::exact);
  Eigen::VectorXd gradient(layout.global_count + layout.coordinates);
  gradient << system.global_gradient(), system.stop_gradient();
  for (int i = 0; i < gradient.size(); ++i) {
    const double h = 1e-6;
    const double numeric =
        (joint_nll(scene.problem, moved(layout, i, h)) - joint_nll(scene.problem, moved(layout, i, -h))) /
        (2 * h);
    // Rounding of the NLL (about 1e3) over the step: 1e3 * 1e-16 / 1e-6, and curvature^3 h^2.
    EXPECT_NEAR(gradient[i], numeric, 1e-5 * (1.0 + std::abs(gradient[i]))) << "coordinate " << i;
  }
}

TEST_P(JointSystemTest, SchurComplementAndStepMatchTheDenseHessian) {
  JointSystem system = make_system();
  const JointLayout& layout = system.layout();
  const int p = layout.global_count, n = p + static_cast<int>(layout.coordinates);
  Eigen::MatrixXd dense(n, n);
  for (int i = 0; i < n; ++i) {  // differences of the analytic gradient
    const double h = 1e-6;
    Eigen::VectorXd up(n), down(n);
    system.assemble(moved(layout, i, h), HessianKind::exact);
    up << system.global_gradient(), system.stop_gradient();
    system.assemble(moved(layout, i, -h), HessianKind::exact);
    down << system.global_gradient(), system.stop_gradient();
    dense.col(i) = (up - down) / (2 * h);
  }
  system.assemble(state, HessianKind::exact);
  ASSERT_TRUE(system.eliminate());
  const int q = n - p;
  const Eigen::MatrixXd stops = dense.bottomRightCorner(q, q);
  const Eigen::MatrixXd schur = dense.topLeftCorner(p, p) -
                                dense.topRightCorner(p, q) * stops.ldlt().solve(dense.bottomLeftCorner(q, p));
  EXPECT_LT((system.schur() - schur).norm(), 1e-5 * schur.norm());
  EXPECT_NEAR(system.log_det_stops(),
              stops.llt().matrixL().toDenseMatrix().diagonal().array().log().sum() * 2, 1e-5);
  Eigen::VectorXd globals = Eigen::VectorXd::LinSpaced(p, -1e-3, 2e-3);
  const Eigen::VectorXd expected =
      -stops.ldlt().solve(system.stop_gradient() + dense.bottomLeftCorner(q, p) * globals);
  EXPECT_LT((system.back_substitute(globals, true) - expected).norm(), 1e-6 * (1e-3 + expected.norm()));
  const Eigen::VectorXd solved = system.solve_stops(system.stop_gradient());
  ASSERT_TRUE(system.factor_stops());  // without the globals: the same factors
  EXPECT_EQ(system.solve_stops(system.stop_gradient()), solved);
  ASSERT_TRUE(system.eliminate());
  const Eigen::MatrixXd inverse = stops.inverse();
  for (std::size_t j = 0; j < layout.nodes.size(); ++j) {
    const auto& node = layout.nodes[j];
    const Eigen::MatrixXd block = inverse.block(node.coordinate, node.coordinate, node.dim, node.dim);
    EXPECT_LT((system.stop_covariance(static_cast<int>(j)) - block).norm(), 1e-5 * block.norm());
  }
}

TEST_P(JointSystemTest, FisherInformationIsTheExpectationOfTheHessian) {
  // At the truth with the cells' means put at their expectation, the exact and the expected matrix agree.
  JointState truth = scene.truth;
  if (GetParam().sigma_s_free) truth.sigma_s_m = 0.015;
  Cells& c = scene.problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const Pose2& pose = truth.stops[c.stop[i]];
    const Eigen::Vector2d v = truth.landmarks[c.landmark[i]] - Eigen::Vector2d(pose.x_m, pose.y_m);
    const double d = v.norm() - c.radius_m[i], f = evaluate_polynomial(truth.alpha, d);
    c.range_mean[i] = f + c.effect_change(i, d);
    c.range_mean_square[i] = std::pow(truth.noise.spread(d, f), 2);
    c.bearing_mean[i] = wrap_angle(std::atan2(v.y(), v.x()) - pose.heading_rad);
    c.bearing_mean_square[i] = truth.sigma_theta_rad * truth.sigma_theta_rad;
  }
  if (GetParam().sigma_s_free || GetParam().options.walk)
    return;  // the stops' errors are not at their expectation
  JointSystem exact = make_system(), fisher = make_system();
  exact.assemble(truth, HessianKind::exact);
  fisher.assemble(truth, HessianKind::fisher);
  ASSERT_TRUE(exact.eliminate());
  ASSERT_TRUE(fisher.eliminate());
  EXPECT_LT((exact.schur() - fisher.schur()).norm(), 1e-8 * exact.schur().norm());
}

TEST_P(JointSystemTest, LogDeterminantGradientMatchesDifferences) {
  // Central differences of 1/2 log det H_ss with the stops settled at each side.
  JointSystem system = make_system();
  ASSERT_NO_FATAL_FAILURE(settle(system));
  const JointLayout& layout = system.layout();
  const Eigen::VectorXd gradient = system.log_det_gradient(state);
  for (int i = 0; i < layout.global_count; ++i) {
    const double h = 1e-5;
    const LaplaceValue up = laplace_marginal(scene.problem, moved(layout, i, h));
    const LaplaceValue down = laplace_marginal(scene.problem, moved(layout, i, -h));
    ASSERT_TRUE(up.ok && down.ok);
    const double numeric =
        ((up.marginal_nll - up.joint_nll) - (down.marginal_nll - down.joint_nll)) / (2 * h);
    EXPECT_NEAR(gradient[i], numeric, 2e-5 * (1.0 + std::abs(numeric))) << "global " << i;
  }
}

TEST_P(JointSystemTest, RestrictedGradientMatchesDifferences) {
  // Central differences of 1/2 log det of the Schur complement on phi, the stops settled at each side.
  const auto half_log_det = [&](const JointState& at) {
    JointSystem system = make_system();
    system.assemble(at, HessianKind::exact);
    EXPECT_TRUE(system.eliminate());
    const int phis = system.layout().phi_count;
    const Eigen::LLT<Eigen::MatrixXd> factor(system.schur().topLeftCorner(phis, phis));
    EXPECT_EQ(factor.info(), Eigen::Success);
    return factor.matrixLLT().diagonal().array().log().sum();
  };
  JointSystem system = make_system();
  ASSERT_NO_FATAL_FAILURE(settle(system));
  const JointLayout& layout = system.layout();
  const Eigen::MatrixXd covariance =
      system.schur().topLeftCorner(layout.phi_count, layout.phi_count).inverse();
  const Eigen::VectorXd gradient = system.log_det_phi_gradient(state, covariance);
  for (int i = 0; i < layout.global_count; ++i) {
    const double h = 1e-6;  // A is ill conditioned here: differences of a wider step bend
    const LaplaceValue up = laplace_marginal(scene.problem, moved(layout, i, h));
    const LaplaceValue down = laplace_marginal(scene.problem, moved(layout, i, -h));
    ASSERT_TRUE(up.ok && down.ok);
    const double numeric = (half_log_det(up.state) - half_log_det(down.state)) / (2 * h);
    EXPECT_NEAR(gradient[i], numeric, 2e-5 * (1.0 + std::abs(numeric))) << "global " << i;
  }
}

INSTANTIATE_TEST_SUITE_P(Shapes, JointSystemTest, ::testing::ValuesIn(system_cases()),
                         [](const auto& test) { return std::string(test.param.name); });

TEST(SettledNodes, FindTheirOptimaFromFarAwayEachByItself) {
  // One stop begins half a metre and a radian off: in steps of all stops at once it held up the others.
  testing::SceneVariants variants({.stops = 6, .landmarks = 4});
  const testing::JointScene scene = make_scene("settled nodes", variants.headings);
  JointState near = scene.truth, far = scene.truth;
  far.stops[2].x_m += 0.5;
  far.stops[2].heading_rad += 1.0;
  JointSystem system(scene.problem, 3, static_cast<int>(far.noise.parameters.size()));
  ASSERT_TRUE(system.settle_nodes(near));
  ASSERT_TRUE(system.settle_nodes(far));
  for (std::size_t k = 0; k < near.stops.size(); ++k) {
    EXPECT_NEAR(far.stops[k].x_m, near.stops[k].x_m, 1e-8) << k;
    EXPECT_NEAR(far.stops[k].y_m, near.stops[k].y_m, 1e-8) << k;
    EXPECT_NEAR(far.stops[k].heading_rad, near.stops[k].heading_rad, 1e-8) << k;
  }
  ASSERT_TRUE(std::isfinite(system.assemble(far, HessianKind::exact)));
  ASSERT_TRUE(system.eliminate());
  EXPECT_LT(system.stop_gradient().dot(system.solve_stops(system.stop_gradient())), 1e-11);
}

TEST(SettledNodes, MoveNothingWhereOneHasNoOptimum) {
  testing::SceneVariants variants({.stops = 6, .landmarks = 4});
  const testing::JointScene scene = make_scene("no optimum", variants.headings);
  JointState state = scene.truth;
  state.stops[1].x_m = std::numeric_limits<double>::quiet_NaN();
  const double before = state.stops[0].x_m;
  JointSystem system(scene.problem, 3, static_cast<int>(state.noise.parameters.size()));
  EXPECT_FALSE(system.settle_nodes(state));
  EXPECT_EQ(state.stops[0].x_m, before);
}

}  // namespace
}  // namespace rangecal
