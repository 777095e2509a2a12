// SPDX-License-Identifier: BSD-3-Clause
// The working problem of models that change means and variances of readings alone, by sums over cells. With h_i the change of reading i,
// m_i what its variance is multiplied by, and y_i - h_i independent given the cell:
//
//   W = sum_i 1 / m_i,   mean = sum_i (y_i - h_i) / m_i / W,   S = sum_i (y_i - h_i - mean)^2 / m_i / W
//   NLL = W ((mean - mu)^2 + S) / (2 s^2) + n log s + 1/2 sum_i log m_i
//
// Where h and m are the same for all repeats these are those of the readings themselves, moved by h: W = n / m, S stays.
#include <algorithm>
#include <cmath>

#include "diagnosis/alternation.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::diagnosis {
namespace {

/// True if the errors of readings stay normal and independent under the model.
bool keeps_errors_normal_and_independent(const Rows& rows, const Model& model) {
  const Dependence shared = dependence_of(model);
  return rows.sequence.empty() && !has_tails(model) && !has_grid(model) && !has_reciprocal_noise(model) &&
         shared.range_cell_sigma_m == 0.0 && shared.bearing_cell_sigma_rad == 0.0 &&
         shared.range_correlation == 0.0 && shared.bearing_correlation == 0.0;
}

/// W, mean, S and sum of ln m of one channel of a cell, whose repeats differ.
struct Moments {
  double weight = 0.0, mean = 0.0, square = 0.0, log_variances = 0.0;

  /// `value` and `log_variance` by repeat, less than `count`.
  template <typename Value, typename LogVariance>
  Moments(int count, const Value& value, const LogVariance& log_variance) {
    for (int i = 0; i < count; ++i) {
      const double log_m = log_variance(i), part = log_m == 0.0 ? 1.0 : std::exp(-log_m);
      weight += part;
      mean += part * value(i);
      log_variances += log_m;
    }
    mean /= weight;
    for (int i = 0; i < count; ++i) {
      const double log_m = log_variance(i), part = log_m == 0.0 ? 1.0 : std::exp(-log_m);
      square += part * (value(i) - mean) * (value(i) - mean);
    }
    square /= weight;
  }
};

}  // namespace

WorkingCells working_cells(const Rows& rows, const Model& model, const JointState& state,
                           const Sides* sides) {
  if (model.empty() || !keeps_errors_normal_and_independent(rows, model))
    return working_problem(rows, model, state, sides);
  WorkingCells working;
  working.problem = rows.problem;
  working.constant = rows.nll_offset;
  CellGeometry geometry = cell_geometry(rows, state);
  geometry.stages = working.stages = stages_of(rows, geometry, model);
  working.problem.stops = commanded_under(rows, model);
  Cells& cells = working.problem.cells;
  if (!rows.pairs) set_effect_slopes(rows, geometry, model, sides, cells);
  const ReadingEffects effects(model);
  std::vector<ReadingChange<double>> own;
  for (int cell = 0; cell < rows.cell_count; ++cell) {
    const auto c = static_cast<std::size_t>(cell);
    const int begin = rows.cell_begin[c], count = rows.cell_begin[c + 1] - begin;
    ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(begin));
    const ReadingChange<double> shared = change_at(model, effects.of_cells, sides, cell, view);
    if (effects.of_rows.empty()) {
      cells.range_weight[c] = count * std::exp(-shared.range_log_variance);
      cells.range_mean[c] -= shared.range;
      working.constant += 0.5 * count * shared.range_log_variance;
      if (!rows.reads_bearings()) continue;
      cells.bearing_weight[c] = count * std::exp(-shared.bearing_log_variance);
      cells.bearing_mean[c] = wrap_angle(cells.bearing_mean[c] - shared.bearing);
      working.constant += 0.5 * count * shared.bearing_log_variance;
      continue;
    }
    own.resize(static_cast<std::size_t>(count));
    for (int i = 0; i < count; ++i) {
      see_row(rows, static_cast<std::size_t>(begin + i), view);
      own[static_cast<std::size_t>(i)] = change_at(model, effects.of_rows, sides, cell, view);
    }
    const Moments range(
        count,
        [&](int i) {
          return rows.range_m[static_cast<std::size_t>(begin + i)] - shared.range -
                 own[static_cast<std::size_t>(i)].range;
        },
        [&](int i) {
          return shared.range_log_variance + own[static_cast<std::size_t>(i)].range_log_variance;
        });
    cells.range_weight[c] = range.weight;
    cells.range_mean[c] = range.mean;
    cells.range_mean_square[c] = range.square;
    working.constant += 0.5 * range.log_variances;
    if (!rows.reads_bearings()) continue;
    const Moments bearing(
        count,
        [&](int i) {
          return wrap_angle(rows.bearing_rad[static_cast<std::size_t>(begin + i)] - shared.bearing -
                            own[static_cast<std::size_t>(i)].bearing - geometry.bearing[c]);
        },
        [&](int i) {
          return shared.bearing_log_variance + own[static_cast<std::size_t>(i)].bearing_log_variance;
        });
    cells.bearing_weight[c] = bearing.weight;
    cells.bearing_mean[c] = wrap_angle(geometry.bearing[c] + bearing.mean);
    cells.bearing_mean_square[c] = bearing.square;
    working.constant += 0.5 * bearing.log_variances;
  }
  return working;
}

}  // namespace rangecal::diagnosis
