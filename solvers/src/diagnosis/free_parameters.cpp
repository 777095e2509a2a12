// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/free_parameters.hpp"

namespace rangecal::diagnosis {

std::vector<FreeParameter> free_parameters(const Rows& rows, const Projector& projector, const Model& model,
                                           int settled) {
  std::vector<FreeParameter> free;
  for (std::size_t e = 0; e < model.size(); ++e) {
    const auto& parameters = model[e].effect->info().parameters;
    const EffectKind kind = model[e].effect->info().kind;
    if (kind == EffectKind::grid || kind == EffectKind::label) continue;  // bookkeeping gave their values
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      if (parameters[j].discrete) continue;
      const auto [low, high] = model[e].effect->bounds(rows.context, j);
      if (!(low < high)) continue;  // this recording says nothing of it
      FreeParameter parameter{static_cast<int>(e), static_cast<int>(j), FreeParameter::Acts::numeric};
      // At zero amplitude a period or a time constant has no slope; probe at the typical size.
      ActiveEffect probe = model[e];
      for (std::size_t a = 0; a < parameters.size(); ++a)
        if (parameters[a].linear && probe.parameters[a] == 0.0) probe.parameters[a] = parameters[a].typical;
      if (projector.raw_information(effect_signature(rows, projector, probe, parameter.index)) > 0.0) {
        parameter.acts = FreeParameter::Acts::mean;
      } else {
        Eigen::VectorXd range, bearing;
        variance_signature(rows, projector.geometry(), probe, parameter.index, range, bearing);
        if (range.squaredNorm() + bearing.squaredNorm() > 0.0) parameter.acts = FreeParameter::Acts::variance;
      }
      if (parameter.acts == FreeParameter::Acts::numeric && parameter.effect < settled) continue;
      free.push_back(parameter);
    }
  }
  return free;
}

}  // namespace rangecal::diagnosis
