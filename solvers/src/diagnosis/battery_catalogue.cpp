// SPDX-License-Identifier: BSD-3-Clause
// What the battery asks of the catalogue: every effect at every point of its start grid.
#include <utility>
#include <vector>

#include "diagnosis/battery.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {

void Battery::ask_catalogue(Of of) {
  const std::vector<const Effect*> effects = effects_of(rows_.context);
  std::vector<std::vector<Asked>> asked(effects.size());
  in_parallel(
      effects.size(),
      [&](std::size_t e) {
        if (of == Of::all || effects[e]->info().kind != EffectKind::mean)
          asked[e] = asked_of_effect(*effects[e]);
      },
      jobs_at_once(rows_.size()));
  for (std::vector<Asked>& of_effect : asked)
    for (Asked& a : of_effect) add(std::move(a));
}

std::vector<Battery::Asked> Battery::asked_of_effect(const Effect& effect) const {
  std::vector<Asked> asked;
  const EffectInfo& info = effect.info();
  if (!effect.lacking(rows_.context).empty()) return asked;
  bool any_linear = false;
  for (const EffectParameter& p : info.parameters) any_linear = any_linear || (p.linear && !p.discrete);
  bool acts_on_mean = false, acts_on_variance = false;
  for (const Eigen::VectorXd& start : effect.start_grid(rows_.context)) {
    const bool unknown = !acts_on_mean && !acts_on_variance;  // a sector may lie where no reading does
    ActiveEffect active{&effect, start};
    std::vector<Signature> block;
    std::vector<Eigen::VectorXd> range_variance, bearing_variance;
    for (int j = 0; j < static_cast<int>(info.parameters.size()); ++j) {
      const EffectParameter& p = info.parameters[j];
      if (p.discrete || (any_linear && !p.linear)) continue;
      if (unknown || acts_on_mean) {
        Signature x = effect_signature(rows_, projector_, active, j);
        if (projector_.raw_information(x) > 0.0) {
          acts_on_mean = true;
          block.push_back(std::move(x));
        }
      }
      if (unknown || acts_on_variance) {
        Eigen::VectorXd range, bearing;
        variance_signature(rows_, projector_.geometry(), active, j, range, bearing);
        acts_on_variance = acts_on_variance || range.squaredNorm() + bearing.squaredNorm() > 0.0;
        if (acts_on_variance) {
          range_variance.push_back(range);
          bearing_variance.push_back(bearing);
        }
      }
    }
    Question q;
    q.channel = info.channel;
    q.covariate = info.covariate;
    q.shape = "effect";
    q.effect = &effect;
    q.start = start;
    if (!block.empty()) asked.push_back(asked_of_mean(q, std::move(block)));
    // The spread that goes along with a mean is no question of its own.
    if (acts_on_variance && info.kind != EffectKind::mean)
      ask_variance_of_rows(q, range_variance, bearing_variance, asked);
    if (!acts_on_mean && !acts_on_variance && info.kind != EffectKind::mean && info.kind != EffectKind::noise)
      break;
  }
  return asked;
}

}  // namespace rangecal::diagnosis
