// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/tail_slopes.hpp"

#include <cmath>

namespace rangecal::diagnosis {
namespace {

/// A parameter of a tail, and the tail with that parameter a little larger and smaller.
struct Probe {
  Eigen::Index column;
  int effect;
  ActiveEffect up, down;
};

}  // namespace

bool is_of_tail(const Model& model, const FreeParameter& p) {
  return p.acts == FreeParameter::Acts::numeric &&
         model[static_cast<std::size_t>(p.effect)].effect->info().kind == EffectKind::tail;
}

SerialErrors::Columns tail_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                  const CellGeometry& geometry,
                                  const std::vector<FreeParameter>& parameters) {
  constexpr double h = 1e-6;  // of the logarithm; what a parameter does to share and size is next to linear
  SerialErrors::Columns slopes = SerialErrors::Columns::Zero(static_cast<Eigen::Index>(rows.size()),
                                                             static_cast<Eigen::Index>(parameters.size()));
  std::vector<Probe> probes;
  for (std::size_t a = 0; a < parameters.size(); ++a) {
    const FreeParameter& p = parameters[a];
    if (!is_of_tail(model, p)) continue;
    const ActiveEffect& active = model[static_cast<std::size_t>(p.effect)];
    probes.push_back({static_cast<Eigen::Index>(a), p.effect, active, active});
    probes.back().up.parameters[p.index] *= std::exp(h);
    probes.back().down.parameters[p.index] *= std::exp(-h);
  }
  if (probes.empty()) return slopes;
  TailLaws laws(rows, geometry, model);
  for (Eigen::Index i = 0; i < slopes.rows(); ++i) {
    const auto row = static_cast<std::size_t>(i);
    const auto cell = static_cast<std::size_t>(rows.cell[row]);
    const TailLaw& law = laws.of(row);
    if (law.empty()) continue;
    TailLaw::Slopes in;
    law.density(working.range_with_tail(i) - geometry.f[cell],
                geometry.spread[cell] * std::exp(0.5 * working.range_log_variance[i]), &in);
    const ReadingView<double> view = view_of(rows, geometry, row);
    for (const Probe& probe : probes)
      for (std::size_t k = 0; k < laws.effects().size(); ++k) {
        if (laws.effects()[k] != probe.effect) continue;
        const Contamination high = probe.up.effect->contamination(view, probe.up.parameters.data()),
                            low = probe.down.effect->contamination(view, probe.down.parameters.data());
        slopes(i, probe.column) =
            (in.in_share[k] * (high.share - low.share) +
             in.in_size[k] * (high.extra_sigma_m + high.mean_m - low.extra_sigma_m - low.mean_m)) /
            (2.0 * h);
      }
  }
  return slopes;
}

}  // namespace rangecal::diagnosis
