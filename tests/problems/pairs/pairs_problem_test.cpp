// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/pairs/pairs_problem.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/problems/pairs/pairs_residual.hpp"

namespace rangecal {
namespace {

const NoiseLaw laws[] = {NoiseLaw::constant, NoiseLaw::f,         NoiseLaw::f_squared,
                         NoiseLaw::f_cubed,  NoiseLaw::d_squared, NoiseLaw::polynomial};

Noise make_noise(NoiseLaw law) {
  Noise noise;
  noise.law = law;
  noise.parameters = law == NoiseLaw::polynomial ? Eigen::VectorXd(Eigen::Vector2d(0.01, 0.02))
                                                 : Eigen::VectorXd::Constant(1, 0.03);
  return noise;
}

/// theta = (alpha, log sigma or beta) -> noise.
Noise noise_from(NoiseLaw law, const Eigen::VectorXd& tail) {
  Noise noise;
  noise.law = law;
  noise.parameters = law == NoiseLaw::polynomial ? tail : Eigen::VectorXd(tail.array().exp());
  return noise;
}

PairsProblem random_problem(std::uint64_t seed, int rows) {
  Random random(seed);
  std::vector<double> d, y;
  for (int i = 0; i < rows; ++i) {
    d.push_back(0.5 + 0.25 * static_cast<double>(random.index(12)));
    const double f = 0.05 + 0.9 * d.back() + 0.05 * d.back() * d.back();
    y.push_back(f + 0.03 * f * f * random.normal());
  }
  return make_pairs_problem(d, y);
}

/// Ridders's extrapolated central difference of fn at 0.
template <typename Function>
double ridders(Function fn, double step) {
  double table[8][8];
  double best = 0.0, error = std::numeric_limits<double>::infinity();
  for (int i = 0; i < 8; ++i, step /= 1.6) {
    table[i][0] = (fn(step) - fn(-step)) / (2.0 * step);
    double factor = 1.6 * 1.6;
    for (int k = 1; k <= i; ++k, factor *= 1.6 * 1.6) {
      table[i][k] = (table[i][k - 1] * factor - table[i - 1][k - 1]) / (factor - 1.0);
      const double change =
          std::fmax(std::abs(table[i][k] - table[i][k - 1]), std::abs(table[i][k] - table[i - 1][k - 1]));
      if (change < error) {
        error = change;
        best = table[i][k];
      }
    }
  }
  return best;
}

TEST(PairsProblem, GroupsEqualDistances) {
  const std::vector<double> d = {2.0, 1.0, 2.0}, y = {2.2, 1.1, 2.0};
  const PairsProblem problem = make_pairs_problem(d, y);
  ASSERT_EQ(problem.size(), 2u);
  EXPECT_EQ(problem.true_m, (std::vector<double>{1.0, 2.0}));
  EXPECT_EQ(problem.count, (std::vector<double>{1.0, 2.0}));
  EXPECT_DOUBLE_EQ(problem.mean_m[1], 2.1);          // (2.2 + 2.0) / 2
  EXPECT_NEAR(problem.mean_square[1], 0.01, 1e-15);  // (0.1^2 + 0.1^2) / 2
  EXPECT_FALSE(problem.single);
  EXPECT_EQ(problem.readings(), 3.0);
}

TEST(PairsProblem, SortsRowsByDistance) {
  const std::vector<double> d = {3.0, 1.0, 4.0, 2.0}, y = {3.3, 1.1, 4.4, 2.2};
  const PairsProblem problem = make_pairs_problem(d, y);
  EXPECT_EQ(problem.row_true_m, (std::vector<double>{1.0, 2.0, 3.0, 4.0}));
  EXPECT_EQ(problem.row_reading_m, (std::vector<double>{1.1, 2.2, 3.3, 4.4}));
  EXPECT_TRUE(problem.single);
}

TEST(PairsProblem, AddsUpWhatRecordingsCount) {
  Recording recordings[2];
  for (Recording& recording : recordings) {
    recording.kind = RecordingKind::pairs;
    recording.pairs.true_m = {1.0, 2.0};
    recording.pairs.reading_m = {1.1, 2.2};
    recording.counts.read = 5;
    recording.counts.used = 2;
    recording.counts.cells_left_out = 1;
    recording.counts.dropped["missing"] = 3;
  }
  const PairsProblem problem = make_pairs_problem(recordings);
  EXPECT_EQ(problem.readings(), 4.0);
  EXPECT_EQ(problem.counts.read, 10);
  EXPECT_EQ(problem.counts.used, 4);
  EXPECT_EQ(problem.counts.cells_left_out, 2);
  EXPECT_EQ(problem.counts.dropped.at("missing"), 6);
}

TEST(PairsProblem, RefusesWrongInput) {
  const std::vector<double> two = {1.0, 2.0}, one = {1.0}, bad = {1.0, std::nan("")};
  EXPECT_THROW(make_pairs_problem(two, one), InputError);
  EXPECT_THROW(make_pairs_problem(bad, two), InputError);
  try {
    make_pairs_problem(two, bad);
    FAIL();
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "pairs: row 1: true_m 2, reading_m nan must be finite");
  }
  const Recording landmarks[1] = {};
  EXPECT_THROW(make_pairs_problem(landmarks), InputError);
}

TEST(PairsNll, HandWorkedValue) {
  // f(2) = 2.5, s = 0.1 * 2.5^2 = 0.625, r = 2.4 - 2.5 = -0.1, r^2 / (2 s^2) = 0.01 / 0.78125 = 0.0128,
  // log 0.625 = -0.47000362925, log(2 pi) / 2 = 0.91893853320: sum 0.46173490396.
  const std::vector<double> d = {2.0}, y = {2.4};
  Noise noise = make_noise(NoiseLaw::f_squared);
  noise.parameters[0] = 0.1;
  EXPECT_NEAR(pairs_nll(make_pairs_problem(d, y), Eigen::Vector2d(0.5, 1.0), noise), 0.46173490396, 1e-11);
}

TEST(PairsNll, CellsAndRowsAgree) {
  const PairsProblem cells = random_problem(seed_from("PairsNll.CellsAndRowsAgree"), 60);
  const PairsProblem rows = pairs_as_rows(cells);
  const Eigen::Vector3d alpha(0.04, 0.92, 0.045);
  for (const NoiseLaw law : laws) {
    const double a = pairs_nll(cells, alpha, make_noise(law)), b = pairs_nll(rows, alpha, make_noise(law));
    EXPECT_NEAR(a, b, 1e-12 * (1.0 + std::abs(a)));
  }
}

TEST(PairsDerivatives, AgreeWithRidders) {
  const PairsProblem problem = random_problem(seed_from("PairsDerivatives.AgreeWithRidders"), 40);
  for (const NoiseLaw law : laws) {
    SCOPED_TRACE(to_string(law));
    const Noise noise = make_noise(law);
    Eigen::VectorXd theta(3 + noise.parameters.size());
    theta << 0.04, 0.92, 0.045,
        (law == NoiseLaw::polynomial ? noise.parameters : Eigen::VectorXd(noise.parameters.array().log()));
    const auto at = [&](const Eigen::VectorXd& x) {
      return pairs_derivatives(problem, x.head(3), noise_from(law, x.tail(x.size() - 3)));
    };
    const PairsDerivatives exact = at(theta);
    EXPECT_NEAR(exact.nll, pairs_nll(problem, theta.head(3), noise), 1e-10);
    const double scale = exact.hessian.cwiseAbs().maxCoeff();
    for (Eigen::Index j = 0; j < theta.size(); ++j) {
      const Eigen::VectorXd unit = Eigen::VectorXd::Unit(theta.size(), j);
      const double step = 0.02 * std::abs(theta[j]);
      const double gradient = ridders([&](double h) { return at(theta + h * unit).nll; }, step);
      EXPECT_NEAR(exact.gradient[j], gradient, 1e-7 * (1.0 + std::abs(gradient)) + 1e-10 * scale);
      for (Eigen::Index k = 0; k < theta.size(); ++k) {
        const double second = ridders([&](double h) { return at(theta + h * unit).gradient[k]; }, step);
        EXPECT_NEAR(exact.hessian(j, k), second, 1e-7 * (1.0 + std::abs(second)) + 1e-10 * scale) << j << k;
      }
    }
  }
}

TEST(PairsDerivatives, InformationIsTheExpectedHessian) {
  // 4000 cells at the truth: the mean Hessian differs from its expectation by about 1 / sqrt(4000) = 1.6 % of a
  // term whose relative spread is up to 4: 10 % of the diagonal bounds it.
  Random random(seed_from("PairsDerivatives.InformationIsTheExpectedHessian"));
  const Eigen::Vector3d alpha(0.05, 0.9, 0.05);
  std::vector<double> d, y;
  for (int i = 0; i < 4000; ++i) {
    d.push_back(random.uniform(0.5, 4.0));
    const double f = alpha[0] + alpha[1] * d.back() + alpha[2] * d.back() * d.back();
    y.push_back(f + 0.03 * f * f * random.normal());
  }
  const PairsDerivatives at =
      pairs_derivatives(make_pairs_problem(d, y), alpha, make_noise(NoiseLaw::f_squared));
  for (Eigen::Index j = 0; j < 4; ++j) {
    for (Eigen::Index k = 0; k < 4; ++k) {
      EXPECT_NEAR(at.hessian(j, k), at.information(j, k),
                  0.1 * std::sqrt(at.information(j, j) * at.information(k, k)));
    }
  }
}

TEST(PairsResidual, HandWorkedValue) {
  // f(2) = 2.5, s = 0.1 * 6.25 = 0.625, floor 0.3125, R = 4, mean 2.4, S = 0.2:
  // 2 * -0.1 / 0.625 = -0.32;  2 * 0.2 / 0.625 = 0.64;  sqrt(8 log 2) = 2.354820045.
  const PairsResidual cell{2.0, 2.4, 0.04, 4.0, NoiseLaw::f_squared, 0.3125};
  const Eigen::VectorXd alpha = Eigen::Vector2d(0.5, 1.0),
                        noise = Eigen::VectorXd::Constant(1, std::log(0.1));
  double r[3] = {NAN, NAN, NAN};
  ASSERT_TRUE(cell.evaluate(alpha, noise, r, nullptr, nullptr));
  EXPECT_NEAR(r[0], -0.32, 1e-14);
  EXPECT_NEAR(r[1], 0.64, 1e-14);
  EXPECT_NEAR(r[2], 2.354820045030949, 1e-12);
  PairsResidual high = cell;
  high.s_floor = 0.7;
  EXPECT_FALSE(high.evaluate(alpha, noise, r, nullptr, nullptr));
}

TEST(PairsResidual, CostIsTheNllAndJacobianAgreesWithRidders) {
  const Eigen::VectorXd alpha = Eigen::Vector3d(0.05, 0.9, 0.05);
  for (const NoiseLaw law : laws) {
    SCOPED_TRACE(to_string(law));
    const Noise noise = make_noise(law);
    const Eigen::VectorXd p =
        law == NoiseLaw::polynomial ? noise.parameters : Eigen::VectorXd(noise.parameters.array().log());
    PairsResidual cell{1.7, 1.8, 0.002, 5.0, law, 0.0};
    cell.s_floor = cell.spread(alpha, p) * std::exp(-0.5);
    double r[3], in_alpha[9], in_noise[6];
    for (double& value : in_alpha) value = NAN;
    for (double& value : in_noise) value = NAN;
    ASSERT_TRUE(cell.evaluate(alpha, p, r, in_alpha, in_noise));

    PairsProblem one;
    one.true_m = {cell.d};
    one.count = one.weight = {cell.count};
    one.mean_m = {cell.mean_m};
    one.mean_square = {cell.mean_square};
    one.row_true_m = one.row_reading_m = {1.7, 1.7, 1.7, 1.7, 1.7};
    const double constant = cell.count * (0.5 * std::log(2.0 * std::numbers::pi) + std::log(cell.s_floor));
    EXPECT_NEAR(0.5 * (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) + constant, pairs_nll(one, alpha, noise),
                1e-12);

    for (int row = 0; row < 3; ++row) {
      const auto value = [&](const Eigen::VectorXd& a, const Eigen::VectorXd& q) {
        double out[3];
        EXPECT_TRUE(cell.evaluate(a, q, out, nullptr, nullptr));
        return out[row];
      };
      for (Eigen::Index j = 0; j < 3; ++j) {
        const double numeric =
            ridders([&](double h) { return value(alpha + h * Eigen::VectorXd::Unit(3, j), p); }, 0.01);
        EXPECT_NEAR(in_alpha[row * 3 + j], numeric, 1e-7 * (1.0 + std::abs(numeric)));  // Ridders's own error
      }
      for (Eigen::Index j = 0; j < p.size(); ++j) {
        const double numeric = ridders(
            [&](double h) { return value(alpha, p + h * Eigen::VectorXd::Unit(p.size(), j)); }, 0.002);
        EXPECT_NEAR(in_noise[row * p.size() + j], numeric, 1e-7 * (1.0 + std::abs(numeric)));
      }
    }
  }
}

TEST(NoiseShape, DensitiesIntegrateToOneAndDerivativesAgree) {
  for (const NoiseShapeParameters shape : {NoiseShapeParameters{NoiseShape::gaussian, 4.0, 0.1, 10.0},
                                           NoiseShapeParameters{NoiseShape::student_t, 3.5, 0.1, 10.0},
                                           NoiseShapeParameters{NoiseShape::contaminated, 4.0, 0.15, 8.0}}) {
    SCOPED_TRACE(to_string(shape.shape));
    // z = sinh(u): trapezoid in u, exponentially exact; tails of t beyond sinh(12) hold less than 1e-15.
    double integral = 0.0;
    for (double u = -12.0; u <= 12.0; u += 0.01) {
      integral += 0.01 * std::cosh(u) * std::exp(log_density(shape, std::sinh(u)).value);
    }
    EXPECT_NEAR(integral, 1.0, 1e-10);
    for (const double z : {-6.0, -0.3, 0.7, 2.5}) {
      const double numeric = ridders([&](double h) { return log_density(shape, z + h).value; }, 0.05);
      EXPECT_NEAR(log_density(shape, z).derivative, numeric, 1e-8);
      EXPECT_NEAR(log_density(shape, z).weight, -numeric / z, 1e-7);
      if (shape.shape == NoiseShape::student_t) {
        const auto in_nu = [&](double h) {
          auto s = shape;
          s.nu += h;
          return log_density(s, z).value;
        };
        EXPECT_NEAR(log_density(shape, z).in_shape[0], ridders(in_nu, 0.1), 1e-8);
      }
      if (shape.shape == NoiseShape::contaminated) {
        const auto in_p = [&](double h) {
          auto s = shape;
          s.outlier_share += h;
          return log_density(s, z).value;
        };
        const auto in_k = [&](double h) {
          auto s = shape;
          s.outlier_scale += h;
          return log_density(s, z).value;
        };
        EXPECT_NEAR(log_density(shape, z).in_shape[0], ridders(in_p, 0.02), 1e-7);
        EXPECT_NEAR(log_density(shape, z).in_shape[1], ridders(in_k, 0.2), 1e-8);
      }
    }
  }
  EXPECT_THROW(noise_shape_from_string("cauchy"), InputError);
  EXPECT_EQ(noise_shape_from_string("student-t"), NoiseShape::student_t);
}

}  // namespace
}  // namespace rangecal
