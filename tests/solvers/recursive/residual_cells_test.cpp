// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/recursive/residual_cells.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {
namespace {

const Eigen::Vector3d curve(0.0525, 0.8838, 0.0584);

double f_at(double d) { return curve[0] + d * (curve[1] + d * curve[2]); }

/// 3 % of the readings late by 0.3 m in the mean.
void fill(ResidualCells& cells, int count, std::vector<double>& d, std::vector<double>& y) {
  Random random(seed_from("residual cells"));
  for (int i = 0; i < count; ++i) {
    d.push_back(random.uniform(0.3, 5.0));
    const double f = f_at(d.back()), late = random.uniform(0.0, 1.0) < 0.03 ? 1.0 : 0.0;
    y.push_back(random.normal(f, 0.01 * f * f) - late * 0.3 * std::log(random.uniform(1e-9, 1.0)));
    cells.add(d.back(), y.back(), 1.0);
  }
}

TEST(ResidualCells, HandWorked) {
  // 63 readings of one distance are kept as they came; with the next they are cells about r = 1 m, t = 1.4826 * 0.001 m.
  ResidualCells cells(0.5, 2.0);
  for (int i = 0; i < 63; ++i) cells.add(1.0, 1.0 + 0.001 * (i % 3 - 1), 1.0);
  EXPECT_EQ(cells.points(1.0, false).size(), 63u);
  EXPECT_EQ(cells.points(2.0, false).readings(), 126.0);
  for (const double late : {0.3, 0.301}) cells.add(1.0, 1.0 + late, 1.0);
  const PairsProblem points = cells.points(1.0, true);
  EXPECT_NEAR(points.readings(), 65.0, 1e-12);
  EXPECT_LE(points.size(), 8u);
  // both late ones in one cell of v = 202 to 304: two points at mean +- standard deviation are themselves
  EXPECT_NEAR(points.mean_m[points.size() - 2] + points.mean_m.back(), 2.601, 1e-9);
  EXPECT_NEAR(std::abs(points.mean_m[points.size() - 2] - points.mean_m.back()), 0.001, 1e-6);
  EXPECT_EQ(points.row_weight_square.size(), points.size());
}

TEST(ResidualCells, SumsOfSecondOrderAreExactAndThoseOfAShapeClose) {
  ResidualCells cells(0.05, 50.0);
  std::vector<double> d, y;
  fill(cells, 20000, d, y);
  cells.refer_to(curve, {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.01)});
  const PairsProblem points = cells.points(1.0, false);
  NoiseShapeParameters late;
  late.shape = NoiseShape::one_sided;
  late.outlier_share = 0.03;
  late.outlier_mean = 0.3;
  const ShapeDensity density(late);
  const auto sums = [&](auto&& weight, const std::vector<double>& at, const std::vector<double>& reading) {
    Eigen::Matrix<double, 5, 1> sum = Eigen::Matrix<double, 5, 1>::Zero();
    for (std::size_t i = 0; i < at.size(); ++i) {
      const double f = f_at(at[i]), s = 0.01 * f * f;
      const LogDensity l = density((reading[i] - f) / s, s);
      sum += weight(i) * Eigen::Matrix<double, 5, 1>(1.0, at[i] * reading[i], reading[i] * reading[i],
                                                     l.value, l.derivative / s);
    }
    return sum;
  };
  const auto exact = sums([](std::size_t) { return 1.0; }, d, y);
  const auto summed = sums([&](std::size_t i) { return points.row_weight[i]; }, points.true_m, points.mean_m);
  for (int k = 0; k < 3; ++k) EXPECT_NEAR(summed[k], exact[k], 1e-9 * exact[k]) << k;
  // The log likelihood to five nats in 30 000, the score of an offset to 3 % of its standard deviation, sqrt(sum 1 / s^2).
  EXPECT_NEAR(summed[3], exact[3], 5.0);
  double information = 0.0;
  for (const double at : d) information += std::pow(0.01 * f_at(at) * f_at(at), -2);
  EXPECT_NEAR(summed[4], exact[4], 0.03 * std::sqrt(information));
}

TEST(ResidualCells, MemoryDoesNotGrow) {
  const auto size_after = [](int count) {
    ResidualCells cells(0.05, 50.0);
    std::vector<double> d, y;
    fill(cells, count, d, y);
    std::size_t size = 0;
    for (const ResidualCells::Bin& bin : cells.bins) size += bin.cells.size() + bin.first.size();
    return size;
  };
  EXPECT_LT(size_after(1000000), 1.5 * static_cast<double>(size_after(100000)));
  EXPECT_LT(size_after(100000), 1200u);
}

}  // namespace
}  // namespace rangecal
