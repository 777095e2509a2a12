// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/pairs/pairs_problem.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

void group_rows(PairsProblem& problem) {
  const std::size_t rows = problem.row_true_m.size();
  for (std::size_t i = 0; i < rows;) {
    std::size_t end = i + 1;
    while (end < rows && problem.row_true_m[end] == problem.row_true_m[i]) ++end;
    const double count = static_cast<double>(end - i);
    double mean = 0.0, square = 0.0;
    for (std::size_t k = i; k < end; ++k) mean += problem.row_reading_m[k];
    mean /= count;
    for (std::size_t k = i; k < end; ++k) {
      const double deviation = problem.row_reading_m[k] - mean;
      square += deviation * deviation;
    }
    problem.true_m.push_back(problem.row_true_m[i]);
    problem.count.push_back(count);
    problem.weight.push_back(count);
    problem.mean_m.push_back(mean);
    problem.mean_square.push_back(square / count);
    problem.single = problem.single && count == 1.0;
    i = end;
  }
}

void sort_rows(PairsProblem& problem) {
  std::vector<std::size_t> order(problem.row_true_m.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return problem.row_true_m[a] < problem.row_true_m[b];
  });
  for (std::vector<double>* column :
       {&problem.row_true_m, &problem.row_reading_m, &problem.row_weight, &problem.row_weight_square}) {
    if (column->empty()) continue;
    std::vector<double> sorted(order.size());
    for (std::size_t i = 0; i < order.size(); ++i) sorted[i] = (*column)[order[i]];
    *column = std::move(sorted);
  }
}

/// s and its derivatives at one distance; `first` and `second` in f, `in_noise` in the noise parameters.
struct Spread {
  double s = 0.0, in_f = 0.0, in_f_f = 0.0;
};

Spread spread_at(const Noise& noise, double d, double f) {
  Spread spread;
  spread.s = noise.spread(d, f);
  const double power = noise.power_of_f();
  if (power > 0.0) {
    spread.in_f = power * spread.s / f;
    spread.in_f_f = power * (power - 1.0) * spread.s / (f * f);
  }
  return spread;
}

}  // namespace

double PairsProblem::readings() const {
  return row_weight.empty() ? static_cast<double>(row_true_m.size())
                            : std::accumulate(row_weight.begin(), row_weight.end(), 0.0);
}

PairsProblem make_weighted_pairs(std::span<const double> true_m, std::span<const double> reading_m,
                                 std::span<const double> weight, std::span<const double> weight_square) {
  if (true_m.size() != reading_m.size() || true_m.size() != weight.size() ||
      (!weight_square.empty() && true_m.size() != weight_square.size()))
    throw InputError(fmt::format("pairs: {} true distances, {} readings, {} weights, {} squares",
                                 true_m.size(), reading_m.size(), weight.size(), weight_square.size()));
  PairsProblem problem;
  problem.row_true_m.assign(true_m.begin(), true_m.end());
  problem.row_reading_m.assign(reading_m.begin(), reading_m.end());
  problem.row_weight.assign(weight.begin(), weight.end());
  problem.row_weight_square.assign(weight_square.begin(), weight_square.end());
  sort_rows(problem);
  return pairs_as_rows(problem);
}

PairsProblem make_pairs_problem(std::span<const double> true_m, std::span<const double> reading_m) {
  if (true_m.size() != reading_m.size()) {
    throw InputError(
        fmt::format("pairs: {} true distances but {} readings", true_m.size(), reading_m.size()));
  }
  PairsProblem problem;
  for (std::size_t i = 0; i < true_m.size(); ++i) {
    if (!std::isfinite(true_m[i]) || !std::isfinite(reading_m[i])) {
      throw InputError(
          fmt::format("pairs: row {}: true_m {}, reading_m {} must be finite", i, true_m[i], reading_m[i]));
    }
  }
  problem.row_true_m.assign(true_m.begin(), true_m.end());
  problem.row_reading_m.assign(reading_m.begin(), reading_m.end());
  problem.counts.read = problem.counts.used = static_cast<int>(true_m.size());
  sort_rows(problem);
  group_rows(problem);
  return problem;
}

PairsProblem make_pairs_problem(std::span<const Recording> recordings) {
  std::vector<double> true_m, reading_m;
  Counts counts;
  for (const Recording& recording : recordings) {
    if (recording.kind != RecordingKind::pairs) {
      throw InputError(fmt::format("{}: kind landmarks where kind pairs is needed", recording.path));
    }
    true_m.insert(true_m.end(), recording.pairs.true_m.begin(), recording.pairs.true_m.end());
    reading_m.insert(reading_m.end(), recording.pairs.reading_m.begin(), recording.pairs.reading_m.end());
    counts.read += recording.counts.read;
    counts.used += recording.counts.used;
    counts.cells_left_out += recording.counts.cells_left_out;
    for (const auto& [reason, number] : recording.counts.dropped) counts.dropped[reason] += number;
  }
  PairsProblem problem = make_pairs_problem(true_m, reading_m);
  problem.counts = counts;
  return problem;
}

PairsProblem pairs_as_rows(const PairsProblem& problem, std::span<const double> weights) {
  if (!weights.empty() && weights.size() != problem.row_true_m.size()) {
    throw InputError(
        fmt::format("pairs: {} weights for {} readings", weights.size(), problem.row_true_m.size()));
  }
  PairsProblem rows;
  rows.row_true_m = rows.true_m = problem.row_true_m;
  rows.row_reading_m = rows.mean_m = problem.row_reading_m;
  rows.row_weight = problem.row_weight;
  rows.row_weight_square = problem.row_weight_square;
  rows.count = problem.row_weight;
  if (rows.count.empty()) rows.count.assign(rows.true_m.size(), 1.0);
  rows.weight = rows.count;
  for (std::size_t i = 0; i < weights.size(); ++i) rows.weight[i] *= weights[i];
  rows.mean_square.assign(rows.true_m.size(), 0.0);
  rows.single = weights.empty() && problem.row_weight.empty();
  rows.counts = problem.counts;
  return rows;
}

double pairs_nll(const PairsProblem& problem, const Eigen::VectorXd& alpha, const Noise& noise) {
  double nll = problem.readings() * half_log_two_pi;
  for (std::size_t i = 0; i < problem.size(); ++i) {
    const double d = problem.true_m[i];
    const double f = evaluate_polynomial(alpha, d);
    const double s = noise.spread(d, f);
    if (!(s > 0.0)) return std::numeric_limits<double>::infinity();
    const double r = problem.mean_m[i] - f;
    nll +=
        problem.count[i] * std::log(s) + problem.weight[i] * (r * r + problem.mean_square[i]) / (2.0 * s * s);
  }
  return nll;
}

PairsDerivatives pairs_derivatives(const PairsProblem& problem, const Eigen::VectorXd& alpha,
                                   const Noise& noise) {
  const Eigen::Index n = alpha.size(), m = noise.parameters.size(), size = n + m;
  const bool polynomial = !has_sigma(noise.law);
  PairsDerivatives out;
  out.nll = problem.readings() * half_log_two_pi;
  out.gradient = Eigen::VectorXd::Zero(size);
  out.hessian = out.information = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd f_j = Eigen::VectorXd::Zero(size), s_j(size);
  for (std::size_t i = 0; i < problem.size(); ++i) {
    const double d = problem.true_m[i];
    const double f = evaluate_polynomial(alpha, d);
    const Spread spread = spread_at(noise, d, f);
    const double s = spread.s;
    if (!(s > 0.0)) {
      out.nll = std::numeric_limits<double>::infinity();
      return out;
    }
    for (Eigen::Index j = 0; j < n; ++j) f_j[j] = j == 0 ? 1.0 : f_j[j - 1] * d;
    s_j.head(n) = spread.in_f * f_j.head(n);
    for (Eigen::Index j = 0; j < m; ++j) s_j[n + j] = !polynomial ? s : j == 0 ? 1.0 : s_j[n + j - 1] * d;

    const double count = problem.count[i], weight = problem.weight[i];
    const double r = problem.mean_m[i] - f;
    const double square = weight * (r * r + problem.mean_square[i]);
    const double s_sq = s * s;
    out.nll += count * std::log(s) + square / (2.0 * s_sq);
    const double l_f = -weight * r / s_sq;
    const double l_s = count / s - square / (s_sq * s);
    out.gradient += l_f * f_j + l_s * s_j;

    const double l_ff = weight / s_sq;
    const double l_fs = 2.0 * weight * r / (s_sq * s);
    const double l_ss = -count / s_sq + 3.0 * square / (s_sq * s_sq);
    out.hessian += l_ff * f_j * f_j.transpose() + l_ss * s_j * s_j.transpose() +
                   l_fs * (f_j * s_j.transpose() + s_j * f_j.transpose());
    out.hessian.topLeftCorner(n, n) += l_s * spread.in_f_f * f_j.head(n) * f_j.head(n).transpose();
    if (!polynomial) {
      out.hessian.col(n).head(n) += l_s * spread.in_f * f_j.head(n);
      out.hessian.row(n).head(n) += l_s * spread.in_f * f_j.head(n).transpose();
      out.hessian(n, n) += l_s * s;
    }
    out.information += count / s_sq * (f_j * f_j.transpose() + 2.0 * s_j * s_j.transpose());
  }
  return out;
}

}  // namespace rangecal
