// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/grids.hpp"

#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>
#include <numbers>
#include <utility>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

/// Counts, mean squares and means of cells with repeats, and each repeat's deviation from its cell's median.
struct Repeats {
  std::vector<double> count, mean_square, f, step_m;
  std::vector<std::vector<double>> deviations_m;
};

/// `changes`: what effects do to ranges, from one repeat to another, and to their variance, e^v on average in a cell, is taken off.
Repeats repeats_of(const Rows& rows, const Model& grids, const RowChanges* changes = nullptr) {
  const Cells& c = rows.problem.cells;
  Repeats repeats;
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (c.count[i] < 2.0) continue;
    repeats.count.push_back(c.count[i]);
    repeats.f.push_back(std::max(c.range_mean[i], 1e-3));
    ReadingView<double> at{};
    at.f = repeats.f.back();
    double step = 0.0;
    for (const ActiveEffect& grid : grids)
      step = std::max(step, grid.effect->grid_steps(at, grid.parameters.data()).range_m);
    repeats.step_m.push_back(step);
    const int begin = rows.cell_begin[i], count = rows.cell_begin[i + 1] - begin;
    Eigen::ArrayXd left = Eigen::Map<const Eigen::ArrayXd>(rows.range_m.data() + begin, count);
    double mean_square = c.range_mean_square[i], factor = 1.0;
    if (changes) {
      left -= changes->range.segment(begin, count).array();
      factor = std::exp(-changes->range_log_variance.segment(begin, count).mean());
      mean_square = factor * (left - left.mean()).square().mean();
    }
    repeats.mean_square.push_back(mean_square);
    std::vector<double> deviations(left.begin(), left.end());
    const double middle = upper_median(deviations);
    for (double& value : deviations) value = std::sqrt(factor) * (value - middle);
    repeats.deviations_m.push_back(std::move(deviations));
  }
  return repeats;
}

/// NLL of the repeats' deviations from their cells' means under s = sigma f^power.
double nll_within(const Repeats& repeats, int power, double sigma) {
  double nll = 0.0;
  for (std::size_t i = 0; i < repeats.count.size(); ++i) {
    const double s = sigma * std::pow(repeats.f[i], power);
    const double variance = s * s + rounding_variance(repeats.step_m[i], s).own;
    nll += 0.5 * ((repeats.count[i] - 1.0) * std::log(variance) +
                  repeats.count[i] * repeats.mean_square[i] / variance);
  }
  return nll;
}

/// Sigma and NLL where that is least.
std::pair<double, double> least_within(const Repeats& repeats, int power) {
  double degrees = 0.0, square = 0.0;
  for (std::size_t i = 0; i < repeats.count.size(); ++i) {
    degrees += repeats.count[i] - 1.0;
    square += repeats.count[i] * repeats.mean_square[i] / std::pow(repeats.f[i], 2 * power);
  }
  const double without_grid = std::sqrt(std::max(square, 1e-300) / degrees);
  if (*std::max_element(repeats.step_m.begin(), repeats.step_m.end()) == 0.0)
    return {without_grid, nll_within(repeats, power, without_grid)};
  constexpr int bits = 24;
  constexpr double least = 1e-3;  // of the sigma that holds the grid's part
  const auto found = boost::math::tools::brent_find_minima(
      [&](double log_sigma) { return nll_within(repeats, power, std::exp(log_sigma)); },
      std::log(least * without_grid), std::log(1.5 * without_grid), bits);
  return {std::exp(found.first), found.second};
}

/// The same of Student's t with 3 degrees of freedom about the cells' medians: what outliers leave of the law. A cell of n
/// repeats counts n - 1 times.
std::pair<double, double> least_within_heavy(const Repeats& repeats, int power) {
  constexpr double nu = 3.0;
  constexpr int iterations = 30;
  std::vector<double> sizes, shares;  // deviations in units of f^power
  double degrees = 0.0, log_units = 0.0;
  for (std::size_t i = 0; i < repeats.count.size(); ++i) {
    const double unit = std::pow(repeats.f[i], power), own = repeats.count[i] - 1.0;
    degrees += own;
    log_units += own * std::log(unit);
    for (double e : repeats.deviations_m[i]) sizes.push_back(std::abs(e) / unit);
    shares.insert(shares.end(), repeats.deviations_m[i].size(), own / repeats.count[i]);
  }
  double variance = std::pow(std::max(upper_median(sizes), 1e-150), 2);
  for (int iteration = 0; iteration < iterations; ++iteration) {  // by the weights of the law
    double square = 0.0;
    for (std::size_t j = 0; j < sizes.size(); ++j)
      square += shares[j] * (nu + 1.0) * sizes[j] * sizes[j] / (nu + sizes[j] * sizes[j] / variance);
    variance = std::max(square / degrees, 1e-300);
  }
  // less the normal's constant
  double nll = log_units + degrees * (0.5 * std::log(variance * nu * std::numbers::pi) + log_gamma(0.5 * nu) -
                                      log_gamma(0.5 * (nu + 1.0)) - half_log_two_pi);
  for (std::size_t j = 0; j < sizes.size(); ++j)
    nll += shares[j] * 0.5 * (nu + 1.0) * std::log1p(sizes[j] * sizes[j] / variance / nu);
  return {std::sqrt(variance), nll};
}

/// The largest step where repeats are alike in a quarter of these cells or more, else 0.
double step_beyond_noise_of(const Repeats& repeats) {
  std::size_t alike = 0;
  double largest = 0.0;
  for (std::size_t i = 0; i < repeats.f.size(); ++i) {
    const double step = repeats.step_m[i];
    largest = std::max(largest, step);
    if (repeats.mean_square[i] < 1e-6 * step * step) ++alike;
  }
  return 4 * alike >= repeats.f.size() ? largest : 0.0;
}

}  // namespace

std::optional<Noise> noise_within_cells(const Rows& rows, const Model& model, const JointState* state) {
  double total = 0.0;
  for (double count : rows.problem.cells.count) total += count - 1.0;
  if (total < 50.0) return std::nullopt;
  std::optional<RowChanges> changes;
  if (state) changes = row_changes(rows, cell_geometry(rows, *state), model);
  const Repeats repeats = repeats_of(rows, model, changes ? &*changes : nullptr);
  const bool alike = step_beyond_noise_of(repeats) > 0.0;  // the few steps tell a level, but no law
  const bool grid = *std::max_element(repeats.step_m.begin(), repeats.step_m.end()) > 0.0;
  std::optional<Noise> best;
  double best_nll = std::numeric_limits<double>::infinity();
  for (const NoiseLaw law : triangulation_first) {
    const int power = Noise{law, Eigen::VectorXd::Ones(1)}.power_of_f();
    auto [sigma, nll] = least_within(repeats, power);
    if (!grid) {
      const auto [heavy_sigma, heavy_nll] = least_within_heavy(repeats, power);
      if (heavy_nll < nll) sigma = heavy_sigma, nll = heavy_nll;
    }
    if (best && (alike || !(nll < best_nll - law_margin))) continue;
    best_nll = nll;
    best = Noise{law, Eigen::VectorXd::Constant(1, sigma)};
  }
  return best;
}

double step_beyond_noise(const Rows& rows, const Model& grids) {
  return has_grid(grids) ? step_beyond_noise_of(repeats_of(rows, grids)) : 0.0;
}

}  // namespace rangecal::diagnosis
