// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {
namespace {

/// What a grid adds beside the variances that the other effects leave; the first reading stands for its cell.
void add_grid(const Rows& rows, const CellGeometry& geometry, const ActiveEffect& grid, RowChanges& changes) {
  CellRounding& rounding = changes.rounding;
  rounding.range.resize(static_cast<std::size_t>(rows.cell_count));
  rounding.bearing.resize(rounding.range.size());
  const auto add = [&rows](int cell, double step, double sigma, Eigen::VectorXd& log_variance,
                           RoundingVariance& cell_rounding) {
    if (!(step > 0.0)) return;
    const int begin = rows.cell_begin[cell], count = rows.cell_begin[cell + 1] - begin;
    const double spread = sigma * std::exp(0.5 * log_variance[begin]);
    cell_rounding = rounding_variance(step, spread);
    log_variance.segment(begin, count).array() += std::log1p(cell_rounding.own / (spread * spread));
  };
  for (int c = 0; c < rows.cell_count; ++c) {
    const auto at = static_cast<std::size_t>(c);
    const ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[c]));
    const GridSteps steps = grid.effect->grid_steps(view, grid.parameters.data());
    add(c, steps.range_m, geometry.spread[at], changes.range_log_variance, rounding.range[at]);
    add(c, rows.pairs ? 0.0 : steps.bearing_rad, geometry.sigma_theta_rad, changes.bearing_log_variance,
        rounding.bearing[at]);
  }
}

bool is_grid(const ActiveEffect& active) { return active.effect->info().kind == EffectKind::grid; }

}  // namespace

bool has_grid(const Model& model) { return std::any_of(model.begin(), model.end(), is_grid); }

Model without_grids(const Model& model) {
  Model others = model;
  std::erase_if(others, is_grid);
  return others;
}

bool has_reciprocal_noise(const Model& model) {
  return std::any_of(model.begin(), model.end(),
                     [](const ActiveEffect& active) { return active.effect->noise_before_reciprocal(); });
}

Dependence dependence_of(const Model& model) {
  Dependence sum;
  for (const ActiveEffect& active : model) {
    if (is_grid(active)) continue;
    const Dependence own = active.effect->dependence(active.parameters.data());
    sum.range_cell_sigma_m = std::hypot(sum.range_cell_sigma_m, own.range_cell_sigma_m);
    sum.bearing_cell_sigma_rad = std::hypot(sum.bearing_cell_sigma_rad, own.bearing_cell_sigma_rad);
    sum.range_correlation += own.range_correlation;
    sum.range_correlated_share *= own.range_correlated_share;
    sum.bearing_correlation += own.bearing_correlation;
  }
  return sum;
}

RowChanges row_changes(const Rows& rows, const CellGeometry& geometry, const Model& model) {
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  RowChanges changes;
  for (auto* column :
       {&changes.range, &changes.bearing, &changes.range_log_variance, &changes.bearing_log_variance})
    *column = Eigen::VectorXd::Zero(n);
  std::vector<const ActiveEffect*> of_readings;
  for (const ActiveEffect& active : model)
    if (!active.effect->noise_before_reciprocal() && !is_grid(active)) of_readings.push_back(&active);
  for (Eigen::Index i = 0; i < n && !of_readings.empty(); ++i) {
    const ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(i));
    for (const ActiveEffect* active : of_readings) {
      const auto change = active->effect->reading(view, active->parameters.data());
      changes.range[i] += change.range;
      changes.bearing[i] += change.bearing;
      changes.range_log_variance[i] += change.range_log_variance;
      changes.bearing_log_variance[i] += change.bearing_log_variance;
    }
  }
  for (const ActiveEffect& active : model)
    if (is_grid(active)) add_grid(rows, geometry, active, changes);
  return changes;
}

}  // namespace rangecal::diagnosis
