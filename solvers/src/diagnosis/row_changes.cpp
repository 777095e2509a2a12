// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "diagnosis/alternation.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/problems/effects/reading_chain.hpp"

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
    if (count == 1) cell_rounding = {0.0, cell_rounding.shared + cell_rounding.own};  // with nobody
    log_variance.segment(begin, count).array() += std::log1p(cell_rounding.own / (spread * spread));
  };
  for (int c = 0; c < rows.cell_count; ++c) {
    const auto at = static_cast<std::size_t>(c);
    const ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[c]));
    const GridSteps steps = grid.effect->grid_steps(view, grid.parameters.data());
    add(c, steps.range_m, geometry.spread[at], changes.range_log_variance, rounding.range[at]);
    add(c, rows.reads_bearings() ? steps.bearing_rad : 0.0, geometry.sigma_theta_rad,
        changes.bearing_log_variance, rounding.bearing[at]);
  }
}

bool is_grid(const ActiveEffect& active) { return active.effect->info().kind == EffectKind::grid; }

/// True of what changes mean or variance of readings one by one.
bool changes_readings(const Effect& effect) {
  return effect.info().kind != EffectKind::grid && !effect.noise_before_reciprocal();
}

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

Model in_order_of_stages(Model model) {
  std::stable_sort(model.begin(), model.end(), [](const ActiveEffect& a, const ActiveEffect& b) {
    return a.effect->info().stage < b.effect->info().stage;
  });
  return model;
}

Stages stages_of(const Rows& rows, const CellGeometry& geometry, const Model& model) {
  Model before_number = in_order_of_stages(model);
  std::erase_if(before_number, [](const ActiveEffect& active) {
    return active.effect->info().stage == Stage::number || active.effect->differs_between_repeats();
  });
  Stages stages;
  if (before_number.empty()) return stages;
  const auto cells = static_cast<std::size_t>(rows.cell_count);
  for (auto* column : {&stages.before_light, &stages.before_spot, &stages.path_gain, &stages.light_gain})
    column->resize(cells);
  for (std::size_t c = 0; c < cells; ++c) {
    const ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[c]));
    ReadingChain chain;
    double of_light = 0.0, of_spot = 0.0;  // slopes in d of what effects of these stages add
    for (const ActiveEffect& active : before_number) {
      const Stage stage = active.effect->info().stage;
      if (stage == Stage::light) of_light += effect_slope_of(active, chain.seen(view));
      if (stage == Stage::spot) of_spot += effect_slope_of(active, chain.seen(view));
      chain.add(*active.effect, active.parameters.data(), view);
    }
    stages.before_light[c] = chain.seen(view).before_light;
    stages.before_spot[c] = chain.seen(view).before_spot;
    stages.light_gain[c] = 1.0 + of_spot;
    stages.path_gain[c] = (1.0 + of_light) * stages.light_gain[c];
  }
  return stages;
}

ReadingEffects::ReadingEffects(const Model& model) {
  for (std::size_t e = 0; e < model.size(); ++e)
    if (const Effect& effect = *model[e].effect; changes_readings(effect))
      (effect.differs_between_repeats() ? of_rows : of_cells).push_back(e);
  std::stable_sort(of_cells.begin(), of_cells.end(), [&](std::size_t a, std::size_t b) {
    return model[a].effect->info().stage < model[b].effect->info().stage;
  });
}

ReadingChange<double> change_at(const Model& model, const std::vector<std::size_t>& effects,
                                const Sides* sides, int cell, const ReadingView<double>& view) {
  ReadingChain chain;
  for (const std::size_t e : effects)
    chain.add(*model[e].effect, model[e].parameters.data(), sides ? sides->seen_by(e, cell, view) : view);
  return chain.sum();
}

RowChanges row_changes(const Rows& rows, const CellGeometry& geometry, const Model& model,
                       const Sides* sides) {
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  RowChanges changes;
  for (auto* column :
       {&changes.range, &changes.bearing, &changes.range_log_variance, &changes.bearing_log_variance})
    *column = Eigen::VectorXd::Zero(n);
  const ReadingEffects effects(model);
  for (int c = 0; c < rows.cell_count && effects.of_cells.size() + effects.of_rows.size() > 0; ++c) {
    const int begin = rows.cell_begin[c], end = rows.cell_begin[c + 1];
    ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(begin));
    const ReadingChange<double> shared = change_at(model, effects.of_cells, sides, c, view);
    for (int i = begin; i < end; ++i) {
      ReadingChange<double> own;
      if (!effects.of_rows.empty()) {
        see_row(rows, static_cast<std::size_t>(i), view);
        own = change_at(model, effects.of_rows, sides, c, view);
      }
      changes.range[i] = shared.range + own.range;
      changes.bearing[i] = shared.bearing + own.bearing;
      changes.range_log_variance[i] = shared.range_log_variance + own.range_log_variance;
      changes.bearing_log_variance[i] = shared.bearing_log_variance + own.bearing_log_variance;
    }
  }
  for (const ActiveEffect& active : model)
    if (is_grid(active)) add_grid(rows, geometry, active, changes);
  return changes;
}

}  // namespace rangecal::diagnosis
