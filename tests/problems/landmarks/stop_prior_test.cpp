// SPDX-License-Identifier: BSD-3-Clause
// Covariances of stops and steps: hand-worked values, and the priors' likelihood against that of one dense
// normal law.
#include "rangecal/problems/landmarks/stop_prior.hpp"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "support/joint_scenes.hpp"

namespace rangecal {
namespace {

const double log_two_pi = std::log(2.0 * std::numbers::pi);

/// -log N(e; 0, C)
double dense_nll(const Eigen::VectorXd& e, const Eigen::MatrixXd& C) {
  const Eigen::LLT<Eigen::MatrixXd> factor(C);
  const double log_det = 2.0 * factor.matrixLLT().diagonal().array().log().sum();
  return 0.5 * (e.dot(factor.solve(e)) + log_det + static_cast<double>(e.size()) * log_two_pi);
}

TEST(StopPrior, HandWorkedCovariance) {
  // Position 0.04 m^2 0.02 m^2, sigma_xy = sqrt(0.03); heading 0.25 rad^2.
  Eigen::Matrix3d C;
  C << 0.04, 0.01, 0.03, 0.01, 0.02, 0.0, 0.03, 0.0, 0.25;
  StopPrior prior;
  set_covariance(C, prior);
  EXPECT_DOUBLE_EQ(prior.sigma_xy_m, std::sqrt(0.03));
  EXPECT_DOUBLE_EQ(prior.sigma_heading_rad, 0.5);
  ASSERT_TRUE(prior.shape);
  EXPECT_NEAR((*prior.shape)(0, 0), 4.0 / 3.0, 1e-15);
  EXPECT_NEAR((*prior.shape)(0, 2), 0.03 / (std::sqrt(0.03) * 0.5), 1e-15);
  EXPECT_LT((covariance_of(prior, prior.sigma_xy_m) - C).norm(), 1e-16);
  // det = 0.04 (0.02 0.25) - 0.01 (0.01 0.25) + 0.03 (0 - 0.02 0.03) = 2e-4 - 2.5e-5 - 1.8e-5 = 1.57e-4.
  const StopInformation information(prior, prior.sigma_xy_m);
  EXPECT_NEAR(information.log_scale, 0.5 * std::log(1.57e-4) + 1.5 * log_two_pi, 1e-12);
  // C^-1 (0, 0) = (0.02 0.25 - 0) / det.
  EXPECT_NEAR(information.W(0, 0), 0.005 / 1.57e-4, 1e-10);
  EXPECT_LT((information.W * C - Eigen::Matrix3d::Identity()).norm(), 1e-12);
  EXPECT_LT((information.root().transpose() * information.root() - information.W).norm(), 1e-10);
  // Twice the sigma of the plane: twice the covariance with the heading, four times that of x and y.
  EXPECT_NEAR(covariance_of(prior, 2.0 * prior.sigma_xy_m)(0, 2), 0.06, 1e-15);
  EXPECT_NEAR(covariance_of(prior, 2.0 * prior.sigma_xy_m)(0, 1), 0.04, 1e-15);
  // Turned where it stood: nothing but the heading.
  prior.opens_place = false;
  const StopInformation turned(prior, prior.sigma_xy_m);
  EXPECT_EQ(turned.W, Eigen::Matrix3d(Eigen::Vector3d(0.0, 0.0, 4.0).asDiagonal()));
  EXPECT_NEAR(turned.log_scale, std::log(0.5) + 0.5 * log_two_pi, 1e-15);
}

TEST(StopPrior, ARoundCovarianceIsThePairOfSigmas) {
  Recording recording;
  for (double sigma : {0.01, 0.3, 1.0 / 3.0}) {
    Stop stop;
    stop.label = std::to_string(recording.stops.size());
    stop.covariance = Eigen::Vector3d(sigma * sigma, sigma * sigma, 0.25 * sigma * sigma).asDiagonal();
    recording.stops.push_back(stop);
  }
  const JointProblem problem = make_joint_problem({&recording, 1});
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_FALSE(problem.stops[k].shape);
    EXPECT_DOUBLE_EQ(problem.stops[k].sigma_xy_m, std::sqrt((*recording.stops[k].covariance)(0, 0)));
    EXPECT_DOUBLE_EQ(problem.stops[k].sigma_heading_rad, 0.5 * problem.stops[k].sigma_xy_m);
  }
  // With a shape that is the unit matrix the general formulas give the same.
  StopPrior round = problem.stops[1], shaped = round;
  shaped.shape = std::make_shared<const Eigen::Matrix3d>(Eigen::Matrix3d::Identity());
  const StopInformation a(round, 0.3), b(shaped, 0.3);
  EXPECT_LT((a.W - b.W).norm(), 1e-14 * a.W.norm());
  EXPECT_NEAR(a.log_scale, b.log_scale, 1e-14);
}

TEST(StopPrior, DrawsHaveTheCovariance) {
  StopPrior prior;
  prior.sigma_xy_m = 0.02;
  prior.sigma_heading_rad = 0.01;
  prior.shape = std::make_shared<const Eigen::Matrix3d>(testing::stop_shape(0));
  Random random(seed_from("DrawsHaveTheCovariance", {}));
  const int draws = 20000;
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (int i = 0; i < draws; ++i) {
    const double x = random.normal(), y = random.normal(), h = random.normal();
    const Eigen::Vector3d e = stop_error(prior, prior.sigma_xy_m, {x, y, h});
    sum += e * e.transpose() / draws;
  }
  const Eigen::Matrix3d C = covariance_of(prior, prior.sigma_xy_m);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)  // var(S_ij) = (C_ii C_jj + C_ij^2) / n; five standard deviations
      EXPECT_NEAR(sum(i, j), C(i, j), 5.0 * std::sqrt((C(i, i) * C(j, j) + C(i, j) * C(i, j)) / draws))
          << i << j;
}

/// A walk over stops with the shapes of joint_scenes.hpp, all errors so small that the path is linear in
/// them.
struct Walk {
  explicit Walk(double sigma_heading) {
    const double sigma = 1e-5;
    Random random(seed_from("dense walk", {}));
    for (int k = 0; k < 6; ++k) {
      StopPrior prior;
      prior.commanded = {0.4 * k, std::sin(0.9 * k), 0.7 * k - 2.0};
      prior.sigma_xy_m = sigma;
      prior.sigma_heading_rad = sigma_heading;
      prior.place = problem.place_count++;
      prior.chained = k > 0;
      prior.shape = std::make_shared<const Eigen::Matrix3d>(testing::stop_shape(k));
      problem.stops.push_back(prior);
      problem.sigma_s_shared.push_back(0);
    }
    state.alpha = Eigen::Vector2d(0.0, 1.0);
    state.noise.parameters = Eigen::VectorXd::Constant(1, 0.01);
    state.stops = draw_stops(problem, state, random.bits());
  }
  /// Errors of the poses, and their covariance by propagation in the world's frame: P' = F P F^T + G C G^T, F
  /// the turn of the step by the heading's error, G the frame of the stop before.
  void dense(Eigen::VectorXd& e, Eigen::MatrixXd& P) const {
    const int n = problem.stop_count();
    e.resize(3 * n);
    P = Eigen::MatrixXd::Zero(3 * n, 3 * n);
    for (int k = 0; k < n; ++k) {
      const StopPrior& prior = problem.stops[k];
      const Pose2 &at = state.stops[k], &c = prior.commanded;
      e.segment<3>(3 * k) << at.x_m - c.x_m, at.y_m - c.y_m, wrap_angle(at.heading_rad - c.heading_rad);
      Eigen::Matrix3d F = Eigen::Matrix3d::Identity(), G = F;
      if (k > 0) {
        const Pose2& before = problem.stops[k - 1].commanded;
        F(0, 2) = -(c.y_m - before.y_m);
        F(1, 2) = c.x_m - before.x_m;
        G.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(before.heading_rad).toRotationMatrix();
        P.block(3 * k, 0, 3, 3 * k) = F * P.block(3 * k - 3, 0, 3, 3 * k);
        P.block(0, 3 * k, 3 * k, 3) = P.block(3 * k, 0, 3, 3 * k).transpose();
        P.block<3, 3>(3 * k, 3 * k) = F * P.block<3, 3>(3 * k - 3, 3 * k - 3) * F.transpose();
      }
      P.block<3, 3>(3 * k, 3 * k) += G * covariance_of(prior, prior.sigma_xy_m) * G.transpose();
    }
  }
  JointProblem problem;
  JointState state;
};

TEST(StopPrior, AWalkOfCorrelatedStepsIsOneDenseNormalLaw) {
  const Walk walk(1e-5);
  Eigen::VectorXd e;
  Eigen::MatrixXd P;
  walk.dense(e, P);
  // The path is linear in its errors but for their squares: 1e-5 of each of 18 terms of order one.
  EXPECT_NEAR(joint_nll_parts(walk.problem, walk.state).stops, dense_nll(e, P), 1e-3);
  // Without the correlations the likelihood is another one.
  JointProblem plain = walk.problem;
  for (StopPrior& prior : plain.stops) prior.shape.reset();
  EXPECT_GT(std::abs(joint_nll_parts(plain, walk.state).stops - dense_nll(e, P)), 0.5);
}

TEST(StopPrior, AWalkWithExactHeadingsIsOneDenseNormalLaw) {
  const Walk walk(0.0);
  Eigen::VectorXd e;
  Eigen::MatrixXd P;
  walk.dense(e, P);
  const int n = walk.problem.stop_count();
  Eigen::VectorXd xy(2 * n);
  Eigen::MatrixXd of_xy(2 * n, 2 * n);
  for (int k = 0; k < n; ++k) {
    xy.segment<2>(2 * k) = e.segment<2>(3 * k);
    for (int j = 0; j < n; ++j) of_xy.block<2, 2>(2 * k, 2 * j) = P.block<2, 2>(3 * k, 3 * j);
  }
  EXPECT_NEAR(joint_nll_parts(walk.problem, walk.state).stops, dense_nll(xy, of_xy), 1e-6);
}

TEST(StopPrior, WhatAStopCannotHaveIsRefused) {
  Recording recording;
  recording.path = "folder";
  recording.stops.resize(2);
  recording.stops[0].label = "a", recording.stops[1].label = "b";
  recording.stops[0].place = recording.stops[1].place = "here";
  const auto message = [&] {
    try {
      make_joint_problem({&recording, 1});
    } catch (const InputError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  recording.stops[1].covariance = Eigen::Vector3d(1e-4, 2e-4, 1e-4).asDiagonal();
  EXPECT_EQ(message(), "no error") << "the heading's variance alone counts";
  (*recording.stops[1].covariance)(0, 2) = (*recording.stops[1].covariance)(2, 0) = 1e-5;
  EXPECT_EQ(
      message(),
      "folder: stop 'b' was turned where it stood, at place 'here': its heading cannot vary with a step; "
      "leave cov_xh_m_rad and cov_yh_m_rad empty");
  recording.stops[1].covariance = Eigen::Vector3d(1e-4, -1e-4, 1e-4).asDiagonal();
  EXPECT_EQ(message(), "folder: stop 'b': cov_yy_m2 is not positive");
}

}  // namespace
}  // namespace rangecal
