// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/bookkeeping.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>
#include <optional>

#include "diagnosis/gaps.hpp"
#include "diagnosis/grids.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double step_that_matters =
    1.0 / 15.0;                           ///< of the spread: less adds four ten-thousandths to the variance
constexpr double many_alike = 1.0 / 6.0;  ///< of the neighbours among a cell's values
constexpr int enough_repeats = 5;         ///< of a cell, to show its grid
constexpr int fewest_repeats = 20;        ///< of all cells, each but its first, to tell the spread

/// Share of values of the cells that repeat another of the same cell to the last digit, and the median step.
struct GridEvidence {
  double repeated = 0.0;  ///< share of all values that stand elsewhere in the recording too
  double share = 0.0, step_over_spread = 0.0, step = 0.0, disparity_step = 0.0;
  double disparity_scatter = 1.0, step_scatter = 1.0;  ///< relative scatter of the steps in 1/r and in r
};

/// The step h by whole numbers of which all values differ: found from the smallest gap g between two of them, g / h = 1 .. 8,
/// and fitted to one value after the other, the smallest first. None where they lie on no such grid: values that know none lie
/// within a twentieth of h of a multiple once in ten.
std::optional<double> common_step(std::vector<double> values) {
  constexpr std::size_t enough = 30;
  constexpr int most_gaps_apart = 8;
  constexpr double near = 0.05;  // of the step
  std::sort(values.begin(), values.end());
  if (values.empty()) return std::nullopt;
  const double rounding = 1e-9 * (values.back() - values.front());
  const auto same = [&](double a, double b) { return b - a <= rounding; };
  values.erase(std::unique(values.begin(), values.end(), same), values.end());
  if (values.size() < enough) return std::nullopt;
  double gap = std::numeric_limits<double>::infinity();
  for (std::size_t i = 1; i < values.size(); ++i) gap = std::min(gap, values[i] - values[i - 1]);
  for (int parts = 1; parts <= most_gaps_apart; ++parts) {
    double step = gap / parts, products = 0.0, squares = 0.0;
    const bool all = std::all_of(values.begin(), values.end(), [&](double value) {
      const double above = value - values.front(), multiple = std::round(above / step);
      if (std::abs(above - multiple * step) > near * step) return false;
      products += above * multiple;
      squares += multiple * multiple;
      if (squares > 0.0) step = products / squares;
      return true;
    });
    if (all) return step;
  }
  return std::nullopt;
}

/// Spread of readings without repeats: how far each lies off the line through its neighbours in distance.
double spread_about_neighbours(const Rows& rows) {
  std::vector<double> d;
  for (const int stop : rows.stop)
    d.push_back(-rows.problem.stops[static_cast<std::size_t>(stop)].commanded.x_m);
  std::vector<std::size_t> order(rows.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return d[a] < d[b]; });
  std::vector<double> sizes;
  for (std::size_t i = 1; i + 1 < order.size(); ++i) {
    const double before = d[order[i - 1]], after = d[order[i + 1]];
    const double share = after > before ? (d[order[i]] - before) / (after - before) : 0.5;
    const double off = rows.range_m[order[i]] - (1.0 - share) * rows.range_m[order[i - 1]] -
                       share * rows.range_m[order[i + 1]];
    sizes.push_back(std::abs(off) / std::sqrt(1.0 + share * share + (1.0 - share) * (1.0 - share)));
  }
  return sizes.empty() ? 0.0 : upper_median(std::move(sizes)) / median_of_normal_size;
}

/// Spread of the repeats of a cell, by all cells together; NaN of too few. `less`: difference of two values.
template <typename Less>
double spread_of_repeats(const Rows& rows, const std::vector<double>& values, Less less) {
  double squares = 0.0;
  for (int c = 0; c < rows.cell_count; ++c) {
    const int begin = rows.cell_begin[c], count = rows.cell_begin[c + 1] - begin;
    Eigen::ArrayXd of_cell(count);
    for (int i = 0; i < count; ++i) of_cell[i] = less(values[begin + i], values[begin]);
    squares += (of_cell - of_cell.mean()).square().sum();
  }
  const int dof = static_cast<int>(rows.size()) - rows.cell_count;
  return dof >= fewest_repeats ? std::sqrt(squares / dof) : std::numeric_limits<double>::quiet_NaN();
}

/// The grid of ranges that repeat too little to show it within a cell: all of them lie on one, in range or in 1/r.
GridEvidence grid_without_repeats(const Rows& rows) {
  GridEvidence evidence;
  const double spread =
      rows.pairs ? spread_about_neighbours(rows) : spread_of_repeats(rows, rows.range_m, std::minus<>());
  if (rows.size() == 0 || !(*std::min_element(rows.range_m.begin(), rows.range_m.end()) > 0.0))
    return evidence;
  std::vector<double> inverse = rows.range_m;
  for (double& value : inverse) value = 1.0 / value;
  const std::optional<double> step = common_step(rows.range_m), of_inverse = common_step(inverse);
  const bool told = rows.pairs ? spread > 0.0 : spread >= 0.0;
  if (!told || (!step && !of_inverse)) return evidence;
  const double middle = upper_median(rows.range_m);
  evidence.repeated = 1.0;
  evidence.step = step ? *step : *of_inverse * middle * middle;
  evidence.disparity_step = step ? 0.0 : *of_inverse;
  evidence.step_scatter = step ? 0.0 : 1.0;
  evidence.disparity_scatter = 1.0 - evidence.step_scatter;
  evidence.step_over_spread = evidence.step / spread;
  return evidence;
}

/// The same of bearings, on either side of the direction behind the sensor.
GridEvidence bearing_grid_without_repeats(const Rows& rows) {
  GridEvidence evidence;
  const std::optional<double> step = common_step(rows.bearing_rad);
  const double spread =
      spread_of_repeats(rows, rows.bearing_rad, [](double a, double b) { return wrap_angle(a - b); });
  if (!step || !(spread >= 0.0)) return evidence;
  evidence.repeated = 1.0;
  evidence.step = *step;
  evidence.step_over_spread = *step / spread;
  return evidence;
}

GridEvidence grid_of_values(const Rows& rows, const std::vector<double>& values) {
  GridEvidence evidence;
  double same = 0.0, all = 0.0;
  std::vector<double> steps, inverse_steps, ratios;
  for (int c = 0; c < rows.cell_count; ++c) {
    std::vector<double> v(values.begin() + rows.cell_begin[c], values.begin() + rows.cell_begin[c + 1]);
    if (v.size() < enough_repeats) continue;
    std::sort(v.begin(), v.end());
    double smallest = 1e9, smallest_inverse = 1e9, mean = 0.0, square = 0.0;
    for (std::size_t i = 1; i < v.size(); ++i) {
      all += 1.0;
      const double gap = v[i] - v[i - 1];
      if (gap < 1e-7 * (1.0 + std::abs(v[i]))) {
        same += 1.0;
        continue;
      }
      smallest = std::min(smallest, gap);
      smallest_inverse = std::min(smallest_inverse, gap / std::abs(v[i] * v[i - 1]));  // of 1/r
    }
    for (double x : v) mean += x / static_cast<double>(v.size());
    for (double x : v) square += (x - mean) * (x - mean) / static_cast<double>(v.size());
    if (smallest < 1e8) {
      steps.push_back(smallest);
      inverse_steps.push_back(smallest_inverse);
      if (square > 0.0) ratios.push_back(smallest / std::sqrt(square));
    }
  }
  if (all < 20.0 || steps.empty()) return evidence;
  evidence.share = same / all;
  std::vector<double> sorted = values;
  std::sort(sorted.begin(), sorted.end());
  double repeated = 0.0;
  for (std::size_t i = 1; i < sorted.size(); ++i)
    if (sorted[i] - sorted[i - 1] < 1e-9 * (1.0 + std::abs(sorted[i]))) repeated += 1.0;
  evidence.repeated = repeated / static_cast<double>(sorted.size());
  evidence.step = upper_median(steps);
  evidence.disparity_step = upper_median(inverse_steps);
  evidence.step_over_spread = ratios.empty() ? 0.0 : upper_median(ratios);
  const auto scatter = [](const std::vector<double>& x, double centre) {
    std::vector<double> off;
    for (double v : x) off.push_back(std::abs(v / centre - 1.0));
    return upper_median(off);
  };
  evidence.step_scatter = scatter(steps, evidence.step);
  evidence.disparity_scatter = scatter(inverse_steps, evidence.disparity_step);
  return evidence;
}

/// The grid of values by the cells with repeats enough, or by all of them, as `of_all` has it. Where few neighbours in the cells of landmarks
/// are alike it is that of all: the smallest gap of a cell is one of its noise.
GridEvidence grid_of(const Rows& rows, const std::vector<double>& values,
                     GridEvidence (*of_all)(const Rows&)) {
  if (rows.context.largest_cell < enough_repeats) return of_all(rows);
  const GridEvidence of_cells = grid_of_values(rows, values);
  if (rows.pairs || of_cells.share > many_alike) return of_cells;
  const GridEvidence found = of_all(rows);
  return found.step > 0.0 ? found : of_cells;
}

void add_range_grid(const GridEvidence& range, Bookkeeping& found) {
  Eigen::VectorXd p = Eigen::VectorXd::Zero(2);
  if (range.disparity_scatter < range.step_scatter)
    p[0] = range.disparity_step;
  else
    p[1] = range.step;
  found.model.push_back({find_effect("quantisation"), p});
  Question q = bookkeeping_question("grid", "range", "steps", certain);
  q.size = range.step;
  found.findings.push_back(q);
}

/// Spreads of the rows' readings under a fit [m], [rad], what its grids add left out.
struct RowSpreads {
  Eigen::ArrayXd range, bearing;
};

RowSpreads spreads_of(const Rows& rows, const Fit& fit) {
  const CellGeometry geometry = cell_geometry(rows, fit.state);
  const RowChanges changes = row_changes(rows, geometry, without_grids(fit.model));
  RowSpreads spreads{(0.5 * changes.range_log_variance).array().exp(),
                     geometry.sigma_theta_rad * (0.5 * changes.bearing_log_variance).array().exp()};
  for (Eigen::Index i = 0; i < spreads.range.size(); ++i) spreads.range[i] *= geometry.spread[rows.cell[i]];
  return spreads;
}

bool has_repeats(const Rows& rows) { return !rows.pairs || rows.context.largest_cell >= 2; }

}  // namespace

Question bookkeeping_question(const char* channel, const char* covariate, const char* shape, double log_p) {
  Question q;
  q.channel = channel;
  q.covariate = covariate;
  q.shape = shape;
  q.of = Question::Of::scalar;
  q.log_p = log_p;
  q.statistic = -2.0 * log_p;
  q.gain = -log_p;
  return q;
}

bool add_grid_beside(const Rows& rows, const Fit& fit, Bookkeeping& known) {
  if (has_grid(known.model) || has_repeats(rows)) return false;
  const GridEvidence range = grid_without_repeats(rows);
  Eigen::ArrayXd spreads = spreads_of(rows, fit).range;
  double* const tenth = spreads.data() + spreads.size() / 10;
  std::nth_element(spreads.data(), tenth, spreads.data() + spreads.size());
  if (!(range.step > *tenth)) return false;
  add_range_grid(range, known);
  known.coarse = true;
  return true;
}

bool drop_fine_grids(const Rows& rows, const Fit& fit, Bookkeeping& known) {
  const CellGeometry geometry = cell_geometry(rows, fit.state);
  const RowSpreads spreads = spreads_of(rows, fit);
  bool any = false;
  for (std::size_t e = known.model.size(); e-- > 0;) {
    const ActiveEffect& active = known.model[e];
    if (active.effect->info().kind != EffectKind::grid) continue;
    std::vector<double> steps, ratios;
    bool of_range = true;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const ReadingView<double> view = view_of(rows, geometry, i);
      const GridSteps grid = active.effect->grid_steps(view, active.parameters.data());
      of_range = grid.range_m > 0.0;
      steps.push_back(of_range ? grid.range_m : grid.bearing_rad);
      ratios.push_back(steps.back() /
                       (of_range ? spreads.range : spreads.bearing)[static_cast<Eigen::Index>(i)]);
    }
    if (steps.empty() || !(upper_median(std::move(ratios)) < step_that_matters)) continue;
    const double step = upper_median(std::move(steps));
    known.notes.push_back(
        of_range
            ? fmt::format("the ranges sit on a grid, here of {:.3g} mm in the middle: far below their spread",
                          1e3 * step)
            : fmt::format("the bearings sit on a grid of {:.3g} mrad: far below their spread", 1e3 * step));
    std::erase_if(known.findings, [&](const Question& q) {
      return q.channel == "grid" && (q.covariate == "range") == of_range;
    });
    known.model.erase(known.model.begin() + static_cast<std::ptrdiff_t>(e));
    any = true;
  }
  return any;
}

Bookkeeping find_grids_and_gaps(const Rows& rows) {
  Bookkeeping found;
  const GridEvidence range = grid_of(rows, rows.range_m, grid_without_repeats),
                     bearing = !rows.reads_bearings()
                                   ? GridEvidence()
                                   : grid_of(rows, rows.bearing_rad, bearing_grid_without_repeats);
  // Rounding far below the spread repeats a value now and then and can be ignored: steps of a fifteenth of the
  // spread, or a sixth of all neighbours alike, are a grid that matters.
  const auto matters = [](const GridEvidence& e) {
    return e.share > many_alike || (e.repeated > 0.03 && e.step_over_spread > step_that_matters);
  };
  // Below the scatter of repeats rounding is more noise, and no more: spreads, tails and dependence are what they are.
  const auto coarse = [](const GridEvidence& e) {
    return !(e.step_over_spread > 0.0) || e.step_over_spread > 1.0;
  };
  const bool on_range = matters(range), on_bearing = matters(bearing);
  // Of readings without repeats only a sequence is judged beside a grid: errors that wander have a name there.
  const bool coarse_range = coarse(range) || (!has_repeats(rows) && rows.sequence.empty());
  found.coarse = (on_range && coarse_range) || (on_bearing && coarse(bearing));
  if (on_range) add_range_grid(range, found);
  if (on_bearing) {
    const Effect* effect = find_effect("bearing_quantisation");
    const auto& parameters = effect->info().parameters;
    Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
    p[0] = bearing.step;
    found.model.push_back({effect, p});
    Question q = bookkeeping_question("grid", "sensor_bearing", "steps", certain);
    q.size = bearing.step;
    found.findings.push_back(q);
  }
  found.step_beyond_noise_m = step_beyond_noise(rows, found.model);
  if (found.step_beyond_noise_m > 0.0)
    found.notes.push_back(fmt::format(
        "of the cells with repeats a quarter or more have them all alike: no change of the ranges below a step of {:.3g} mm "
        "can be told",
        1e3 * found.step_beyond_noise_m));
  const Gaps gaps = gaps_of(rows);
  // Where most are missing, stops do not look in turns, and the fullest cell is no measure.
  if (gaps.missing < 5.0 || gaps.missing > 0.5 * gaps.expected || gaps.chance > 0.01) return found;
  const Effect* effect = find_effect("dropout");
  Eigen::VectorXd p(1);
  p[0] = *std::max_element(rows.range_m.begin(), rows.range_m.end());
  found.model.push_back({effect, p});
  Question q = bookkeeping_question("detection", "range", "linear", std::log(gaps.chance));
  q.from = gaps.from_m;
  q.size = gaps.missing / gaps.expected;
  found.findings.push_back(q);
  found.notes.push_back(fmt::format("{:.0f} readings ({:.1f} %) are missing, and more of them far away",
                                    gaps.missing, 100.0 * q.size));
  return found;
}

}  // namespace rangecal::diagnosis
