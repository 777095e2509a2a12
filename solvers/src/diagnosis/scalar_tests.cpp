// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/scalar_tests.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "statistics/kurtosis_law.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double longest_gap = 3.0;  ///< usual ones, between readings that are neighbours
constexpr double fewest_products = 20.0, fewest_values = 40.0, fewest_stops = 3.0;
constexpr double least_share =
    0.2;  ///< of a cell mean's variance, for its residual to say something of tails

/// Sums of powers of values about zero.
struct Moments {
  double n = 0.0, second = 0.0, third = 0.0, fourth = 0.0;

  void add(double z) {
    n += 1.0;
    second += z * z;
    third += z * z * z;
    fourth += z * z * z * z;
  }
};

}  // namespace

double skewness_z(double skewness, double n) {
  const double y = skewness * std::sqrt((n + 1.0) * (n + 3.0) / (6.0 * (n - 2.0)));
  const double beta = 3.0 * (n * n + 27.0 * n - 70.0) * (n + 1.0) * (n + 3.0) /
                      ((n - 2.0) * (n + 5.0) * (n + 7.0) * (n + 9.0));
  const double w_sq = -1.0 + std::sqrt(2.0 * (beta - 1.0));
  const double delta = 1.0 / std::sqrt(0.5 * std::log(w_sq)), alpha = std::sqrt(2.0 / (w_sq - 1.0));
  return delta * std::asinh(y / alpha);
}

ScalarTests::ScalarTests(const Rows& rows, const Projector& projector, const JointProblem& problem,
                         Eigen::VectorXd range_dof, Eigen::VectorXd bearing_dof)
    : rows_(rows), range_dof_(std::move(range_dof)), bearing_dof_(std::move(bearing_dof)) {
  if (rows.pairs) return;
  const JointLayout& layout = projector.system().layout();
  for (std::size_t j = 0; j < layout.nodes.size(); ++j) {
    const JointLayout::Node& node = layout.nodes[j];
    const StopPrior& prior = problem.stops[node.stops.front()];
    if (!node.free_position || prior.chained) continue;
    const Eigen::LLT<Eigen::Matrix2d> expected(covariance_of(prior, prior.sigma_xy_m).topLeftCorner<2, 2>());
    const Eigen::Matrix2d left =
        projector.system().stop_covariance(static_cast<int>(j)).topLeftCorner<2, 2>();
    nodes_.push_back({node.coordinate, expected.matrixL().solve(Eigen::Matrix2d::Identity()),
                      std::max(0.0, 1.0 - 0.5 * expected.solve(left).trace())});
  }
}

void ScalarTests::ask_rows(const std::string& channel, const Eigen::VectorXd& rows,
                           const Eigen::VectorXd& cells, const Eigen::VectorXd& dof,
                           std::vector<ScalarTest>& tests) const {
  const bool of_range = channel == "range";
  double sum = 0.0, products = 0.0;
  Moments values;
  for (int c = 0; c < rows_.cell_count; ++c) {
    const int begin = rows_.cell_begin[c], end = rows_.cell_begin[c + 1], count = end - begin;
    if (count > 2) {
      const double share = (count - 1.0) / count, scale = 1.0 / std::sqrt(share);
      for (int i = begin + 1; i < end; ++i) sum += rows[i] * rows[i - 1];
      sum += share;
      products += (count - 1.0) * share;
      for (int i = begin; i < end; ++i) values.add(scale * rows[i]);
      continue;
    }
    // of two readings one difference is independent of the mean
    if (count == 2) values.add(std::numbers::sqrt2 * rows[begin]);
    if (dof[c] > least_share) values.add(cells[c] / std::sqrt(dof[c]));
  }
  if (of_range) {
    const Sequence& sequence = rows_.sequence;
    for (std::size_t i = 0; i < sequence.before.size(); ++i) {
      if (sequence.before[i] < 0 || sequence.gap[i] > longest_gap) continue;
      sum += cells[static_cast<Eigen::Index>(i)] * cells[sequence.before[i]];
      products += 1.0;
    }
  }
  if (products > fewest_products)
    tests.push_back({channel + "_dependence", "repeat", "lag 1", sum / std::sqrt(products), sum / products});
  if (!(values.n > fewest_values)) return;
  const double second = std::max(values.second / values.n, 1e-300);
  const double kurtosis = values.fourth / values.n / (second * second);
  const double skewness = values.third / values.n / std::pow(second, 1.5);
  tests.push_back(
      {channel + "_tail", "any", "heavy tails", kurtosis_score(kurtosis, values.n), kurtosis - 3.0});
  tests.push_back({channel + "_tail", "range", "skew", skewness_z(skewness, values.n), skewness});
}

void ScalarTests::ask_stops(const Eigen::VectorXd& shifts, std::vector<ScalarTest>& tests) const {
  double squares = 0.0, shares = 0.0, variance = 0.0, product = 0.0, product_variance = 0.0;
  Eigen::Vector2d before = Eigen::Vector2d::Zero();
  double before_share = 0.0;
  for (const Node& node : nodes_) {
    const Eigen::Vector2d error = node.unit * shifts.segment<2>(node.coordinate);
    squares += 0.5 * error.squaredNorm();
    shares += node.share;
    variance += node.share * node.share;
    if (before_share > 0.0) {
      product += error.dot(before);
      product_variance += 2.0 * node.share * before_share;
    }
    before = error;
    before_share = node.share;
  }
  if (!(variance > fewest_stops)) return;
  // The sum of squares has the mean and variance of a scaled chi-square's with 2 shares^2 / variance degrees of
  // freedom (Satterthwaite 1946), and its cube root is normal (Wilson and Hilferty 1931).
  const double k = variance / (9.0 * shares * shares), excess = (squares - shares) / variance;
  tests.push_back({"stop", "stop", "spread", (std::cbrt(squares / shares) - 1.0 + k) / std::sqrt(k),
                   std::max(-1.0, excess)});
  if (product_variance > fewest_stops)
    tests.push_back(
        {"stop", "stop", "lag 1", product / std::sqrt(product_variance), product / product_variance});
}

std::vector<ScalarTest> ScalarTests::of(const UnitResiduals& residuals) const {
  std::vector<ScalarTest> tests;
  ask_rows("range", residuals.range_rows, residuals.range_cells, range_dof_, tests);
  if (rows_.pairs) return tests;
  if (rows_.reads_bearings())
    ask_rows("bearing", residuals.bearing_rows, residuals.bearing_cells, bearing_dof_, tests);
  ask_stops(residuals.stops, tests);
  return tests;
}

}  // namespace rangecal::diagnosis
