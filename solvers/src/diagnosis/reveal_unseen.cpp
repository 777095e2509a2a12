// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/reveal_unseen.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "diagnosis/twins.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double calliper_m = 2e-4;  ///< standard deviation of a radius measured with a calliper

/// Effects that the change lets one ask of pairs, at their typical size there: those for which this recording lacks times,
/// targets or repeats, and those that have more starts with a covariate that the change varies. Stops and landmarks
/// bring targets and repeats whatever is changed: of them the changes are ranked by what the recording could show at all.
std::vector<TypicalEffect> opened_by(const ExtendedDesign& design, const Space& there, const Space& here) {
  const EffectContext& context = design.rows.context;
  EffectContext without = context;
  const auto varied = std::find(without.covariates.begin(), without.covariates.end(), design.varies);
  if (varied != without.covariates.end()) {
    if (!without.columns.empty())
      without.columns.erase(without.columns.begin() + (varied - without.covariates.begin()));
    without.covariates.erase(varied);
  }
  std::vector<TypicalEffect> opened;
  for (const Effect* effect : effects_of(context)) {
    const bool named = std::any_of(here.model().begin(), here.model().end(),
                                   [&](const ActiveEffect& active) { return active.effect == effect; });
    if (named || !effect->lacking(context).empty()) continue;
    const bool lacked = !effect->lacking(here.rows().context).empty();
    if (!lacked &&
        (design.varies.empty() || effect->start_grid(context).size() == effect->start_grid(without).size()))
      continue;
    if (std::optional<TypicalEffect> typical = typical_effect(there, *effect))
      opened.push_back(std::move(*typical));
  }
  return opened;
}

}  // namespace

void reveal_unseen(const std::vector<PossibleChange>& menu, const SearchResult& found,
                   const DiagnoseOptions& options, const Space& here,
                   const std::vector<TypicalEffect>& effects, Diagnosis& result) {
  struct Hidden {
    const TypicalEffect* typical;
    double range_error, power;
  };
  std::vector<Hidden> hidden;
  const auto power_of = [&](const TypicalEffect& typical, double noncentrality) {
    const double questions = found.rates.questions(typical.active.effect->info().id);
    return detection_power(noncentrality, options.alarm_rate, questions);
  };
  for (const Unseen& unseen : result.unseen)
    for (const TypicalEffect& typical : effects)
      if (typical.active.effect->info().id == unseen.effect)
        hidden.push_back({&typical, unseen.harm_m, power_of(typical, typical.noncentrality)});
  struct Ranked {
    NextExperiment next;
    double score = 0.0;
  };
  std::vector<Ranked> list;
  const auto judge = [&](const MenuEntry& entry, const std::vector<Hidden>& opened,
                         const auto& noncentrality) {
    Ranked scored{{entry.code, entry.change, {}, 0.0}, 0.0};
    double weights = 0.0;
    const auto count = [&](const Hidden& h, double power) {
      const std::string& id = h.typical->active.effect->info().id;
      std::vector<std::string>& settles = scored.next.settles;
      if (power < 0.1 || power < 2.0 * h.power + 0.05 ||
          std::find(settles.begin(), settles.end(), id) != settles.end())
        return;
      const double weight = std::max(h.range_error, 1e-6);
      settles.push_back(id);
      scored.next.power += weight * power;
      scored.score += weight * (power - h.power);
      weights += weight;
    };
    for (const Hidden& h : opened) count(h, power_of(*h.typical, h.typical->noncentrality));
    for (const Hidden& h : hidden) count(h, power_of(*h.typical, noncentrality(*h.typical)));
    if (weights == 0.0) return;
    scored.next.power /= weights;
    list.push_back(std::move(scored));
  };
  for (const PossibleChange& change : menu) {
    const Space space(change.design.rows, in_design(change.design, here.model()), change.design.state);
    std::vector<TypicalEffect> brought;
    if (here.rows().pairs) brought = opened_by(change.design, space, here);
    std::vector<Hidden> opened;
    for (const TypicalEffect& typical : brought) {
      const std::string& id = typical.active.effect->info().id;
      const auto known = std::find_if(hidden.begin(), hidden.end(), [&](const Hidden& h) {
        return h.typical->active.effect->info().id == id;
      });
      const bool seen = known == hidden.end() &&
                        std::any_of(effects.begin(), effects.end(), [&](const TypicalEffect& other) {
                          return other.active.effect->info().id == id;
                        });
      const double range_error = range_error_of(space, typical);
      if (seen || !std::isfinite(range_error)) continue;
      opened.push_back({&typical, range_error, known == hidden.end() ? 0.0 : known->power});
    }
    judge(change.entry, opened, [&](const TypicalEffect& typical) {
      const Model model = in_design(change.design, {typical.active});
      return space.change(model).information + shape_noncentrality(space, typical.active);
    });
  }
  // A radius wrong by dR in the same way on the calliper as in the recording: lambda = (dR / sigma)^2.
  double radius = 0.0;
  for (double r : here.rows().problem.landmark_radius_m) radius = std::max(radius, r);
  if (radius > 0.0)
    judge({"E5", "measure the landmarks with a calliper"}, {}, [&](const TypicalEffect& typical) {
      const std::string& id = typical.active.effect->info().id;
      const double size = typical.index >= 0 ? typical.active.parameters[typical.index] : 0.0;
      const double error = id == "radius_scale"                              ? size * radius
                           : id == "range_offset" || id == "landmark_radius" ? size
                                                                             : 0.0;
      return std::pow(error / calliper_m, 2);
    });
  std::stable_sort(list.begin(), list.end(),
                   [](const Ranked& a, const Ranked& b) { return a.score > b.score; });
  for (Ranked& scored : list) {
    const bool listed =
        std::any_of(result.next_experiments.begin(), result.next_experiments.end(),
                    [&](const NextExperiment& next) { return next.code == scored.next.code; });
    if (!listed) result.next_experiments.push_back(std::move(scored.next));
  }
}

}  // namespace rangecal::diagnosis
