// SPDX-License-Identifier: BSD-3-Clause
// What the battery asks beyond the means: variances, periods within cells, dependence and tails.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "diagnosis/battery.hpp"
#include "in_parallel.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double pi = std::numbers::pi;

}  // namespace

void Battery::ask_variance_of_rows(const Question& question, const std::vector<Eigen::VectorXd>& range,
                                   const std::vector<Eigen::VectorXd>& bearing,
                                   std::vector<Asked>& asked) const {
  for (bool of_bearing : {false, true}) {
    if (of_bearing && !rows_.reads_bearings()) continue;
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
    if (!shapes.empty()) asked.push_back(asked_of_variance(question, shapes, of_bearing));
  }
}

/// Units: within a cell R - 1 degrees of freedom; between, what the calibration leaves of one.
void Battery::fill_variance_units() {
  const int cells = rows_.cell_count;
  const Cells& c = working_.problem.cells;
  const double parameters = static_cast<double>(projector_.system().layout().alpha_count);
  const auto fill = [&](VarianceUnits& units, bool bearing) {
    units.square.resize(2 * cells);
    units.dof.resize(2 * cells);
    Signature unit;
    unit.range = unit.bearing = Eigen::VectorXd::Zero(cells);
    const Eigen::VectorXd white =
        bearing ? projector_.bearing_residual.cwiseProduct(projector_.bearing_information.cwiseSqrt()).eval()
                : range_cell_scores_;
    for (int i = 0; i < cells; ++i) {
      const double information =
          bearing ? projector_.bearing_information[i] : projector_.range_information[i];
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
      units.square[cells + i] = white[i] * white[i];
      units.dof[cells + i] = std::max(left, 1e-6);
    }
    cell_chi_sq += units.square.tail(cells).sum();
    cell_dof += units.dof.tail(cells).sum();
  };
  fill(range_units, false);
  if (rows_.reads_bearings()) fill(bearing_units, true);
}

void Battery::ask_variances() {
  const int cells = rows_.cell_count;
  const CellGeometry& g = projector_.geometry();
  for (bool of_bearing : {false, true}) {
    if (of_bearing && !rows_.reads_bearings()) continue;
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
      add(asked_of_variance(std::move(q), shapes, of_bearing));
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
  const double step = 0.5 / rows_.context.duration_s;  // two points per resolvable frequency
  const int count = static_cast<int>(std::min(4000.0, 0.5 / upper_median(std::move(gaps)) / step));
  std::vector<Question> asked(rows_.reads_bearings() ? 2 : 1);
  in_parallel(asked.size(), [&](std::size_t channel) {
    const bool of_bearing = channel == 1;
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
    Question& q = asked[channel];
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
  });
  for (Question& q : asked) keep(std::move(q));
}

void Battery::ask_between_cells() {
  const int cells = rows_.cell_count;
  for (bool of_bearing : {false, true}) {
    if (of_bearing && !rows_.reads_bearings()) continue;
    const VarianceUnits& units = of_bearing ? bearing_units : range_units;
    if (!(units.dof.head(cells).sum() > 0.5 * cells)) continue;  // no repeats
    Eigen::VectorXd between = Eigen::VectorXd::Zero(2 * cells);
    between.tail(cells).setOnes();
    Question q;
    q.channel = of_bearing ? "bearing_dependence" : "range_dependence";
    q.covariate = "any";
    q.shape = "between cells";
    add(asked_of_variance(q, {between}, of_bearing));
  }
}

void Battery::ask_scalars() {
  const int cells = rows_.cell_count;
  UnitResiduals residuals;
  residuals.range_rows = range_scores_;
  residuals.range_cells = range_cell_scores_;
  residuals.stops = Eigen::VectorXd::Zero(projector_.system().layout().coordinates);
  Eigen::VectorXd bearing_dof;
  if (rows_.reads_bearings()) {
    residuals.bearing_rows = bearing_scores_;
    residuals.bearing_cells =
        projector_.bearing_residual.cwiseProduct(projector_.bearing_information.cwiseSqrt());
    bearing_dof = bearing_units.dof.tail(cells);
  }
  if (!rows_.pairs) {
    for (const JointLayout::Node& node : projector_.system().layout().nodes) {
      if (!node.free_position) continue;
      const int k = node.stops.front();
      const Pose2& meant = working_.problem.stops[k].commanded;
      residuals.stops.segment<2>(node.coordinate) << state_.stops[k].x_m - meant.x_m,
          state_.stops[k].y_m - meant.y_m;
    }
  }
  scalar_tests_.emplace(rows_, projector_, working_.problem, range_units.dof.tail(cells), bearing_dof);
  for (const ScalarTest& test : scalar_tests_->of(residuals)) add_scalar(test);
}

}  // namespace rangecal::diagnosis
