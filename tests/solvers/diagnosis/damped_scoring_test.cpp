// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/damped_scoring.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace rangecal::diagnosis {
namespace {

struct Point {
  Eigen::VectorXd x;
  double nll = std::numeric_limits<double>::infinity();
};

/// x^T A x / 2 - b^T x with an ill-conditioned A, every x_j up to `most`.
struct Quadratic {
  Eigen::MatrixXd A;
  Eigen::VectorXd b;
  double most = 1e9;
  int gradients = 0;

  explicit Quadratic(int n) : A(n, n), b(Eigen::VectorXd::LinSpaced(n, 1.0, 2.0)) {
    for (int i = 0; i < n; ++i)
      for (int j = 0; j < n; ++j) A(i, j) = 1.0 / (1.0 + i + j);  // Hilbert's
    A.diagonal().array() += 1e-3;
  }

  Point at(const Eigen::VectorXd& x) const { return {x, 0.5 * x.dot(A * x) - b.dot(x)}; }

  /// Least of it from 0, with `information` as the matrix that is known, in so many steps.
  Point least(const Eigen::MatrixXd& information, LackOfInformation& lack, int most_steps = many_steps) {
    return scored(
        "quadratic", at(Eigen::VectorXd::Zero(b.size())),
        [&](const Point& p) {
          ++gradients;
          return ScoringSlopes{b - A * p.x, information, {}};
        },
        [&](const Point& p, const Eigen::VectorXd& step) {
          return Eigen::VectorXd((p.x + step).cwiseMin(most) - p.x);
        },
        [&](const Point& p, const Eigen::VectorXd& step) { return at(p.x + step); }, lack, most_steps);
  }
  Point least(const Eigen::MatrixXd& information) {
    LackOfInformation lack(b.size());
    return least(information, lack);
  }
};

TEST(DampedScoring, GoesOnWithWhatWasLearnedOnTheWayToAFitCloseBy) {
  Quadratic of(4);
  const Eigen::MatrixXd information = of.A.diagonal().asDiagonal();
  LackOfInformation lack(4);
  of.least(information, lack);
  const int at_first = std::exchange(of.gradients, 0);
  of.b += Eigen::VectorXd::Constant(4, 0.05);  // another optimum of the same curvature
  const double expected = of.at(of.A.ldlt().solve(of.b)).nll;
  EXPECT_LT(of.least(information, lack).nll - expected, 0.01);
  EXPECT_LT(of.gradients, at_first / 2);
}

TEST(DampedScoring, EndsAfterTheStepsThatItMayTake) {
  Quadratic of(4);
  LackOfInformation lack(4);
  of.least(20.0 * of.A, lack, 3);
  EXPECT_EQ(of.gradients, 1 + 3);
}

TEST(DampedScoring, TakesOneStepWhereTheInformationIsTheHessian) {
  Quadratic of(4);
  const Eigen::VectorXd expected = of.A.ldlt().solve(of.b);
  const Point found = of.least(of.A);
  EXPECT_LT(of.at(expected).nll - found.nll, 1e-6);
  EXPECT_GT(found.nll - of.at(expected).nll, -1e-6);
  EXPECT_LE(of.gradients, 2);
}

// With M = 20 A as the information, k steps by M alone leave (19 / 20)^(2 k) of what there is to gain: a tenth of a nat in 43 after 60 of
// them; a diagonal knows nothing of what the parameters have in common. What every step teaches of A makes it a dozen or two.
TEST(DampedScoring, LearnsWhatTheInformationLacks) {
  Quadratic of(4);
  const double least = of.at(of.A.ldlt().solve(of.b)).nll;
  EXPECT_NEAR(of.least(20.0 * of.A).nll, least, 0.01);
  EXPECT_LE(of.gradients, 15);
  of.gradients = 0;
  EXPECT_NEAR(of.least(Eigen::MatrixXd(of.A.diagonal().asDiagonal())).nll, least, 0.01);
  EXPECT_LE(of.gradients, 30);
}

// With A / 50 as the information the first step is 50 times too long. What the NLL does over it says how far to go.
TEST(DampedScoring, AStepThatFailsTeachesTheCurvatureAlongIt) {
  Quadratic of(4);
  const double least = of.at(of.A.ldlt().solve(of.b)).nll;
  EXPECT_NEAR(of.least(0.02 * of.A).nll, least, 0.01);
  EXPECT_LE(of.gradients, 12);

  LackOfInformation lack(2);
  const Eigen::Matrix2d information = Eigen::Vector2d(1.0, 4.0).asDiagonal();
  const Eigen::Vector2d step(2.0, 0.0);
  lack.learn_curvature(step, 4.0, -2.0, information);  // of a curvature of 3 along x: 4 - 3 * 2^2 / 2 = -2
  EXPECT_NEAR((information + lack.matrix())(0, 0), 3.0, 1e-12);
  EXPECT_NEAR((information + lack.matrix())(1, 1), 4.0, 1e-12);
  lack.learn_curvature(step, 4.0, -1e9, information);  // no shorter than a tenth of the step
  EXPECT_NEAR((information + lack.matrix())(0, 0), 10.0, 1e-12);
}

TEST(DampedScoring, WhatWasLearnedElsewhereLeavesTheHessianPositive) {
  LackOfInformation lack(2);
  const Eigen::Matrix2d there = Eigen::Vector2d(100.0, 1.0).asDiagonal(), here = Eigen::Matrix2d::Identity();
  lack.learn(Eigen::Vector2d(1.0, 0.0), Eigen::Vector2d(20.0, 0.0), there);  // of 100 the curvature lacks 80
  EXPECT_NEAR((there + lack.matrix())(0, 0), 20.0, 1e-12);
  EXPECT_LT((here + lack.matrix())(0, 0), 0.0);
  lack.stay_positive(here);
  EXPECT_GT((here + lack.matrix())(0, 0), 0.0);
}

TEST(DampedScoring, SolvesForTheOthersWhereOneIsAtItsBound) {
  Quadratic of(2);
  of.A << 2.0, 1.0, 1.0, 3.0;
  of.b << 8.0, 3.0;  // least at (4.2, -0.4); with x_0 <= 1 at x_1 = (3 - 1) / 3
  of.most = 1.0;
  const Point found = of.least(of.A);
  EXPECT_EQ(found.x[0], 1.0);
  EXPECT_NEAR(found.x[1], 2.0 / 3.0, 0.05);
}

}  // namespace
}  // namespace rangecal::diagnosis
