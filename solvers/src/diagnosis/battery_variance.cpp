// SPDX-License-Identifier: BSD-3-Clause
// What the battery asks beyond the means: variances, dependence between readings and between stops, tails.
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "diagnosis/battery.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double pi = std::numbers::pi;

/// Sample skewness turned normal (D'Agostino 1970) for n values.
double skewness_z(double skewness, double n) {
  const double y = skewness * std::sqrt((n + 1.0) * (n + 3.0) / (6.0 * (n - 2.0)));
  const double beta = 3.0 * (n * n + 27.0 * n - 70.0) * (n + 1.0) * (n + 3.0) /
                      ((n - 2.0) * (n + 5.0) * (n + 7.0) * (n + 9.0));
  const double w_sq = -1.0 + std::sqrt(2.0 * (beta - 1.0));
  const double delta = 1.0 / std::sqrt(0.5 * std::log(w_sq)), alpha = std::sqrt(2.0 / (w_sq - 1.0));
  return delta * std::asinh(y / alpha);
}

/// Sample kurtosis m4 / m2^2 turned normal (Anscombe and Glynn 1983) for n values.
double kurtosis_z(double kurtosis, double n) {
  const double mean = 3.0 * (n - 1.0) / (n + 1.0);
  const double variance = 24.0 * n * (n - 2.0) * (n - 3.0) / ((n + 1.0) * (n + 1.0) * (n + 3.0) * (n + 5.0));
  const double x = (kurtosis - mean) / std::sqrt(variance);
  const double moment = 6.0 * (n * n - 5.0 * n + 2.0) / ((n + 7.0) * (n + 9.0)) *
                        std::sqrt(6.0 * (n + 3.0) * (n + 5.0) / (n * (n - 2.0) * (n - 3.0)));
  const double a = 6.0 + 8.0 / moment * (2.0 / moment + std::sqrt(1.0 + 4.0 / (moment * moment)));
  const double cube = (1.0 - 2.0 / a) / (1.0 + x * std::sqrt(2.0 / (a - 4.0)));
  return (1.0 - 2.0 / (9.0 * a) - std::cbrt(cube)) / std::sqrt(2.0 / (9.0 * a));
}

}  // namespace

void Battery::ask_variance_of_rows(const Question& question, const std::vector<Eigen::VectorXd>& range,
                                   const std::vector<Eigen::VectorXd>& bearing) {
  for (bool of_bearing : {false, true}) {
    if (of_bearing && rows_.pairs) continue;
    std::vector<Eigen::VectorXd> shapes;
    for (const Eigen::VectorXd& rows : of_bearing ? bearing : range) {
      if (rows.squaredNorm() == 0.0) continue;
      Eigen::VectorXd units(2 * rows_.cell_count);
      for (int c = 0; c < rows_.cell_count; ++c) {
        const int begin = rows_.cell_begin[c], count = rows_.cell_begin[c + 1] - begin;
        units[c] = units[rows_.cell_count + c] = rows.segment(begin, count).mean();
      }
      shapes.push_back(units);
    }
    if (!shapes.empty()) add_variance(question, shapes, of_bearing);
  }
}

void Battery::ask_variances() {
  const int cells = rows_.cell_count;
  const Cells& c = working_.problem.cells;
  const CellGeometry& g = projector_.geometry();
  // Units: within a cell R - 1 degrees of freedom; between, what the calibration leaves of one.
  const double parameters = static_cast<double>(projector_.system().layout().alpha_count);
  const auto fill = [&](VarianceUnits& units, bool bearing) {
    units.square.resize(2 * cells);
    units.dof.resize(2 * cells);
    Signature unit;
    unit.range = unit.bearing = Eigen::VectorXd::Zero(cells);
    for (int i = 0; i < cells; ++i) {
      const double information =
          bearing ? projector_.bearing_information[i] : projector_.range_information[i];
      const double residual = bearing ? projector_.bearing_residual[i] : projector_.range_residual[i];
      const double count = rows_.cell_begin[i + 1] - rows_.cell_begin[i];
      const double mean_square = bearing ? c.bearing_mean_square[i] : c.range_mean_square[i];
      units.square[i] = information * mean_square;
      if (rescored_)
        units.square[i] = (bearing ? bearing_scores_ : range_scores_)
                              .segment(rows_.cell_begin[i], rows_.cell_begin[i + 1] - rows_.cell_begin[i])
                              .squaredNorm();
      units.dof[i] = count - 1.0;
      double left = 1.0 - parameters / cells;
      if (!rows_.pairs) {
        Eigen::VectorXd& column = bearing ? unit.bearing : unit.range;
        column[i] = 1.0;
        left = projector_.project(unit)[bearing ? cells + i : i] / information;
        column[i] = 0.0;
      }
      units.square[cells + i] = information * residual * residual;
      units.dof[cells + i] = std::max(left, 1e-6);
    }
    cell_chi_sq += units.square.tail(cells).sum();
    cell_dof += units.dof.tail(cells).sum();
  };
  fill(range_units, false);
  if (!rows_.pairs) fill(bearing_units, true);

  for (bool of_bearing : {false, true}) {
    if (of_bearing && rows_.pairs) continue;
    const std::string channel = of_bearing ? "bearing_noise" : "range_noise";
    const auto ask = [&](const std::string& covariate, const std::string& shape,
                         const std::vector<std::function<double(int)>>& slopes,
                         std::optional<double> from = {}, std::optional<double> to = {},
                         const std::string& group = {}) {
      std::vector<Eigen::VectorXd> shapes;
      for (const auto& slope : slopes) {
        Eigen::VectorXd units(2 * cells);
        for (int i = 0; i < cells; ++i) units[i] = units[cells + i] = slope(i);
        shapes.push_back(units);
      }
      Question q;
      q.channel = channel;
      q.covariate = covariate;
      q.shape = shape;
      q.from = from;
      q.to = to;
      q.group = group;
      add_variance(std::move(q), shapes, of_bearing);
    };
    const auto row = [&](int i) { return rows_.cell_begin[i]; };
    ask("range", "linear", {[&](int i) { return std::log(g.d[i]); }});
    ask("range", "smooth",
        {[&](int i) { return std::log(g.d[i]); }, [&](int i) { return g.d[i]; },
         [&](int i) { return 1.0 / g.d[i]; }});
    ask("sensor_bearing", "harmonic 1",
        {[&](int i) { return std::cos(g.bearing[i]); }, [&](int i) { return std::sin(g.bearing[i]); }});
    ask("sensor_bearing", "harmonic 2",
        {[&](int i) { return std::cos(2 * g.bearing[i]); },
         [&](int i) { return std::sin(2 * g.bearing[i]); }});
    for (int sector = 0; sector < 12; ++sector) {
      const double centre = 2.0 * pi * sector / 12.0;
      ask("sensor_bearing", "bump", {[&](int i) {
            return std::abs(std::remainder(g.bearing[i] - centre, 2.0 * pi)) < pi / 6.0 ? 1.0 : 0.0;
          }},
          std::remainder(centre - pi / 6.0, 2 * pi), std::remainder(centre + pi / 6.0, 2 * pi));
    }
    if (rows_.context.duration_s > 0.0) {
      ask("time", "linear", {[&](int i) { return rows_.time_s[row(i)]; }});
      for (int from = 0; from < 12; ++from)
        for (int width : {1, 3})
          ask("time", "bump", {[&](int i) {
                const double share = 12.0 * rows_.time_s[row(i)] / rows_.context.duration_s;
                return share >= from && share < from + width ? 1.0 : 0.0;
              }},
              rows_.context.duration_s * from / 12.0, rows_.context.duration_s * (from + width) / 12.0);
    }
    for (int l = 0; l < rows_.context.landmark_count && rows_.context.landmark_count > 1; ++l)
      ask("landmark", "one group", {[&](int i) { return rows_.landmark[row(i)] == l ? 1.0 : 0.0; }}, {}, {},
          rows_.context.landmark_labels[l]);
    if (!rows_.pairs && rows_.context.stop_count <= 400)
      for (int k = 0; k < rows_.context.stop_count; ++k)
        ask("stop", "one group", {[&](int i) { return rows_.stop[row(i)] == k ? 1.0 : 0.0; }}, k, k,
            std::to_string(k));
    for (std::size_t column = 0; column < rows_.context.covariates.size(); ++column)
      ask(rows_.context.covariates[column], "linear", {[&](int i) {
            const double v = rows_.covariates[row(i) * rows_.context.covariates.size() + column];
            return std::isfinite(v) ? v : 0.0;
          }});
  }
}

void Battery::ask_periods() {
  // Lomb's periodogram of the deviations within the cells, over all periods that the repeats resolve. One
  // question: the largest of F peaks, each chi-square with two degrees of freedom.
  const Eigen::Index n = static_cast<Eigen::Index>(rows_.size());
  if (!(rows_.context.duration_s > 0.0) || rows_.context.largest_cell < 4 || n < 50) return;
  std::vector<double> gaps;
  for (Eigen::Index i = 1; i < n; ++i)
    if (rows_.cell[i] == rows_.cell[i - 1] && rows_.time_s[i] > rows_.time_s[i - 1])
      gaps.push_back(rows_.time_s[i] - rows_.time_s[i - 1]);
  if (gaps.empty()) return;
  std::nth_element(gaps.begin(), gaps.begin() + static_cast<long>(gaps.size() / 2), gaps.end());
  const double step = 0.5 / rows_.context.duration_s;  // two points per resolvable frequency
  const int count = std::min(4000, static_cast<int>(0.5 / gaps[gaps.size() / 2] / step));
  for (bool of_bearing : {false, true}) {
    if (of_bearing && rows_.pairs) continue;
    const Eigen::ArrayXd scores = (of_bearing ? bearing_scores_ : range_scores_).array();
    Eigen::ArrayXd cosine = Eigen::ArrayXd::Ones(n), sine = Eigen::ArrayXd::Zero(n), turn_c(n), turn_s(n),
                   next(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      turn_c[i] = std::cos(2.0 * pi * step * rows_.time_s[i]);
      turn_s[i] = std::sin(2.0 * pi * step * rows_.time_s[i]);
    }
    double best = 0.0, best_period = 0.0;
    const double scale = scores.square().mean();
    for (int f = 1; f <= count; ++f) {
      next = cosine * turn_c - sine * turn_s;
      sine = sine * turn_c + cosine * turn_s;
      cosine = next;
      const double power = 2.0 * (std::pow((scores * cosine).sum(), 2) + std::pow((scores * sine).sum(), 2)) /
                           (static_cast<double>(n) * std::max(scale, 1e-12));
      if (power > best) {
        best = power;
        best_period = 1.0 / (f * step);
      }
    }
    Question q;
    q.channel = of_bearing ? "bearing" : "range";
    q.covariate = "time";
    q.shape = fmt::format("periodic, {:.3g} s", best_period);
    q.of = Question::Of::scalar;
    q.dof = 2;
    q.statistic = best;
    q.gain = std::max(0.0, 0.5 * best - std::log(static_cast<double>(count)));  // less what choosing it cost
    q.log_p = std::min(0.0, log_chi_sq_survival(best, 2) + std::log(static_cast<double>(count)));
    q.size = std::sqrt(best / static_cast<double>(n)) *
             (of_bearing
                  ? state_.sigma_theta_rad
                  : Eigen::Map<const Eigen::VectorXd>(projector_.geometry().spread.data(), projector_.cells())
                        .mean());
    keep(std::move(q));
  }
}

void Battery::ask_dependence_and_tails() {
  const int cells = rows_.cell_count;
  for (bool of_bearing : {false, true}) {
    if (of_bearing && rows_.pairs) continue;
    const std::string prefix = of_bearing ? "bearing" : "range";
    const VarianceUnits& units = of_bearing ? bearing_units : range_units;
    const Eigen::VectorXd& scores = of_bearing ? bearing_scores_ : range_scores_;
    if (units.dof.head(cells).sum() > 0.5 * cells) {  // there are repeats
      Eigen::VectorXd between = Eigen::VectorXd::Zero(2 * cells);
      between.tail(cells).setOnes();
      Question q;
      q.channel = prefix + "_dependence";
      q.covariate = "any";
      q.shape = "between cells";
      add_variance(q, {between}, of_bearing);

      // Lag-1 products of the deviations from the cell means; their expectation is -(R - 1) / R per cell.
      double sum = 0.0, pairs = 0.0;
      for (int c = 0; c < cells; ++c) {
        const int begin = rows_.cell_begin[c], end = rows_.cell_begin[c + 1];
        if (end - begin < 3) continue;
        const double scale = units.dof[c] / (end - begin);  // (R - 1) / R
        for (int i = begin + 1; i < end; ++i) sum += scores[i] * scores[i - 1];
        sum += scale;
        pairs += (end - begin - 1) * scale;
      }
      if (pairs > 20.0) {
        q.covariate = "repeat";
        q.shape = "lag 1";
        add_scalar(q, sum / std::sqrt(pairs));
        questions.back().size = sum / pairs;
      }
    }
    // Tails of the deviations, noise law and dependence taken out.
    double n = 0.0, second = 0.0, third = 0.0, fourth = 0.0;
    for (int c = 0; c < cells; ++c) {
      const int begin = rows_.cell_begin[c], end = rows_.cell_begin[c + 1];
      const double count = end - begin;
      for (int i = begin; i < end; ++i) {
        const double z =
            count > 2
                ? scores[i] * std::sqrt(count / (count - 1.0))
                : (of_bearing ? projector_.bearing_residual[c] * std::sqrt(projector_.bearing_information[c])
                              : projector_.range_residual[c] * std::sqrt(projector_.range_information[c]));
        n += 1.0;
        second += z * z;
        third += z * z * z;
        fourth += z * z * z * z;
      }
    }
    if (n > 40.0 && second > 0.0) {
      second /= n;
      Question q;
      q.channel = prefix + "_tail";
      q.covariate = "any";
      q.shape = "heavy tails";
      add_scalar(q, kurtosis_z(fourth / n / (second * second), n));
      questions.back().size = fourth / n / (second * second) - 3.0;
      q.covariate = "range";
      q.shape = "skew";
      add_scalar(q, skewness_z(third / n / std::pow(second, 1.5), n));
      questions.back().size = third / n / std::pow(second, 1.5);
    }
  }
  if (rows_.pairs) return;

  // Stops: their errors against the prior, expected with what the readings leave of it.
  const JointLayout& layout = projector_.system().layout();
  double excess = 0.0, variance = 0.0, step_sum = 0.0, step_variance = 0.0;
  Eigen::Vector2d before = Eigen::Vector2d::Zero();  // error over its standard deviation
  double before_share = 0.0;
  for (std::size_t j = 0; j < layout.nodes.size(); ++j) {
    const JointLayout::Node& node = layout.nodes[j];
    const int k = node.stops.front();
    const StopPrior& prior = working_.problem.stops[k];
    if (!node.free_position || prior.chained) continue;
    const Eigen::LLT<Eigen::Matrix2d> expected(covariance_of(prior, prior.sigma_xy_m).topLeftCorner<2, 2>());
    const Eigen::Vector2d error = expected.matrixL().solve(Eigen::Vector2d(
        state_.stops[k].x_m - prior.commanded.x_m, state_.stops[k].y_m - prior.commanded.y_m));
    const Eigen::Matrix2d covariance =
        projector_.system().stop_covariance(static_cast<int>(j)).topLeftCorner<2, 2>();
    const double share = std::max(0.0, 1.0 - 0.5 * expected.solve(covariance).trace());
    excess += 0.5 * (error.squaredNorm() - 2.0 * share);
    variance += share * share;
    if (before_share > 0.0) {
      step_sum += error.dot(before);
      step_variance += 2.0 * share * before_share;
    }
    before = error;
    before_share = share;
  }
  if (variance > 3.0) {
    Question q;
    q.channel = "stop";
    q.covariate = "stop";
    q.shape = "spread";
    // Degrees of freedom 4 variance: the cube makes the sum of squares normal.
    const double dof = 2.0 * variance, ratio = std::max(1e-9, 1.0 + excess / variance), k = 2.0 / (9.0 * dof);
    add_scalar(q, (std::cbrt(ratio) - 1.0 + k) / std::sqrt(k));
    questions.back().size = excess / variance;
    q.shape = "lag 1";
    if (step_variance > 3.0) add_scalar(q, step_sum / std::sqrt(step_variance));
  }
}

}  // namespace rangecal::diagnosis
