// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/training_part.hpp"

#include <algorithm>
#include <cmath>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/subset.hpp"

namespace rangecal::diagnosis {
namespace {

/// Parameters of dependence and tails, which have no score: one parabola through three values of l_s, the
/// rest held.
void fit_numeric(const Rows& rows, const Fit& full, Model& model, const JointState& state) {
  for (const FreeParameter& p : full.free) {
    if (p.acts != FreeParameter::Acts::numeric) continue;
    const auto [lowest, highest] = bounds_of(rows, model, p);
    double& value = value_of(model, p);
    const double centre = value, step = 0.2 * std::max(std::abs(centre), 0.2 * size_of(info_of(model, p)));
    const auto at = [&](double x) {
      value = std::clamp(x, lowest, highest);
      JointState trial = state;
      return laplace_value(rows, model, trial);
    };
    const double low = at(centre - step), high = at(centre + step), middle = at(centre);
    const double curvature = low - 2.0 * middle + high;
    const double shift = curvature > 0.0 ? std::clamp(0.5 * (low - high) / curvature, -2.0, 2.0) : 0.0;
    const double there = at(centre + shift * step);
    if (!(there <= middle)) value = centre;
  }
}

void forget_unseen(const Rows& rows, const JointState& state, Model& model) {
  const CellGeometry geometry = cell_geometry(rows, state);
  for (ActiveEffect& active : model) {
    const std::vector<EffectParameter>& parameters = active.effect->info().parameters;
    if (active.effect->info().kind != EffectKind::mean) continue;
    const RowChanges with = row_changes(rows, geometry, {active});
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      if (!parameters[j].linear || parameters[j].discrete) continue;
      ActiveEffect other = active;
      other.parameters[static_cast<Eigen::Index>(j)] = 0.0;
      const RowChanges without = row_changes(rows, geometry, {other});
      if (with.range == without.range && with.bearing == without.bearing) active = std::move(other);
    }
  }
}

}  // namespace

void add_squares(const Rows& rows, const std::vector<char>& out, const Model& model, const JointState& state,
                 HeldOut& held) {
  if (!rows.pairs) return;
  const CellGeometry geometry = cell_geometry(rows, state);
  const RowChanges changes = row_changes(rows, geometry, model);
  for (int c = 0; c < rows.cell_count; ++c) {
    if (!out[static_cast<std::size_t>(c)]) continue;
    const int begin = rows.cell_begin[static_cast<std::size_t>(c)],
              end = rows.cell_begin[static_cast<std::size_t>(c) + 1];
    double error = 0.0;
    for (int i = begin; i < end; ++i) {
      const double predicted = geometry.f[static_cast<std::size_t>(c)] + changes.range[i] +
                               tail_law_of(rows, geometry, model, static_cast<std::size_t>(i)).mean();
      error += (rows.range_m[static_cast<std::size_t>(i)] - predicted) / (end - begin);
    }
    held.squares += error * error;
    held.cells += 1.0;
  }
}

HeldOut sum_of(const std::vector<HeldOut>& parts) {
  HeldOut all;
  for (const HeldOut& held : parts) {
    all.nll += held.nll;
    all.squares += held.squares;
    all.cells += held.cells;
    all.parts.insert(all.parts.end(), held.parts.begin(), held.parts.end());
    all.ok = all.ok && held.ok;
  }
  return all;
}

Fit fit_part(const Rows& rest, const Fit& full, RefitOptions options, int iterations) {
  const bool numeric = std::any_of(full.free.begin(), full.free.end(), [](const FreeParameter& p) {
    return p.acts == FreeParameter::Acts::numeric;
  });
  options.max_iterations = iterations;
  Fit fit = full;
  forget_unseen(rest, fit.state, fit.model);
  if (!numeric) return refit(rest, fit.model, fit.state, options);
  fit_numeric(rest, full, fit.model, full.state);
  const bool others = std::any_of(full.free.begin(), full.free.end(), [](const FreeParameter& p) {
    return p.acts != FreeParameter::Acts::numeric;
  });
  if (others) return refit(rest, fit.model, fit.state, as_they_are(fit, options));
  fit.nll = calibrate_under(rest, fit.model, fit.state, options);
  fit.ok = std::isfinite(fit.nll);
  return fit;
}

}  // namespace rangecal::diagnosis
