// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/skewed_score.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::diagnosis {
namespace {

/// A shape that is 1 in the first units and 0 elsewhere, its level taken out, normalised.
Eigen::VectorXd first_units(int ones, const Eigen::VectorXd& dof) {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(dof.size());
  x.head(ones).setOnes();
  x.array() -= dof.dot(x) / dof.sum();
  return x / std::sqrt(0.5 * dof.dot(x.cwiseAbs2()));
}

TEST(SkewedScore, OneUnitHasTheTailOfItsChiSquare) {
  // One unit of n degrees of freedom, x = sqrt(2 / n): score s at q = n + s sqrt(2 n). Normal scores of
  // chi2.sf(q, n) by SciPy 1.10: n = 1, s = 5.5 (z of the reading 2.96): 2.7425; s = 3: 2.0133; n = 4, s = 4: 2.6443.
  struct Case {
    double dof, score, z;
  };
  for (const Case& c : {Case{1.0, 5.5, 2.7425}, Case{1.0, 3.0, 2.0133}, Case{4.0, 4.0, 2.6443}}) {
    const Eigen::VectorXd dof = Eigen::VectorXd::Constant(1, c.dof);
    const std::vector<double> third =
        third_cumulants({Eigen::VectorXd::Constant(1, std::sqrt(2.0 / c.dof))}, dof);
    ASSERT_EQ(third.size(), 1u);
    EXPECT_NEAR(third[0], std::sqrt(8.0 / c.dof), 1e-12);
    const double chi_sq = skewed_chi_square(Eigen::VectorXd::Constant(1, c.score), third);
    EXPECT_NEAR(std::sqrt(chi_sq), c.z, 0.03) << c.dof << " " << c.score;
    EXPECT_EQ(skewed_chi_square(Eigen::VectorXd::Constant(1, -0.5), third), 0.25);  // the light side stays
  }
}

TEST(SkewedScore, ManyUnitsAreNormal) {
  const Eigen::VectorXd dof = Eigen::VectorXd::Constant(400, 9.0);
  const std::vector<double> third = third_cumulants({first_units(200, dof)}, dof);
  EXPECT_NEAR(third[0], 0.0, 1e-12);  // half against half: no skewness
  EXPECT_NEAR(skewed_chi_square(Eigen::VectorXd::Constant(1, 4.0), third), 16.0, 1e-9);
}

// Two shapes, one of them on two readings of 60: of 4e5 draws the share beyond the chi-square's 0.1 % point, which a
// plain sum of squares exceeds ten times too often.
TEST(SkewedScore, ItsTailIsTheChiSquares) {
  const int units = 60, draws = 400000;
  const Eigen::VectorXd dof = Eigen::VectorXd::Ones(units);
  const Eigen::VectorXd near = first_units(2, dof);
  Eigen::VectorXd far = Eigen::VectorXd::LinSpaced(units, 0.0, 1.0);
  far.array() -= far.mean();
  far -= 0.5 * near.dot(far) * near;
  far /= std::sqrt(0.5 * far.squaredNorm());
  const std::vector<double> third = third_cumulants({near, far}, dof);
  const double point = 13.8155;  // chi2.isf(1e-3, 2)
  Random random(seed_from("SkewedScore.ItsTailIsTheChiSquares"));
  int beyond = 0, plain = 0;
  Eigen::VectorXd excess(units);
  for (int draw = 0; draw < draws; ++draw) {
    for (double& e : excess) e = std::pow(random.normal(), 2) - 1.0;
    const Eigen::VectorXd scores = Eigen::Vector2d(0.5 * near.dot(excess), 0.5 * far.dot(excess));
    plain += scores.squaredNorm() > point;
    beyond += skewed_chi_square(scores, third) > point;
  }
  // 400 expected where the law is exact; the approximation may be off by a half, 4 standard deviations of 20 beside.
  EXPECT_GT(plain, 2000);
  EXPECT_LT(beyond, 680);
  EXPECT_GT(beyond, 120);
}

}  // namespace
}  // namespace rangecal::diagnosis
