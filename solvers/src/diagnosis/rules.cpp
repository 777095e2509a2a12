// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/rules.hpp"

#include <algorithm>
#include <cmath>

#include "diagnosis/rounds.hpp"
#include "diagnosis/separation.hpp"

namespace rangecal::diagnosis {
namespace {

/// Nats by which a free curve may beat a name before it is refused: 4, or for strong ones 5 %, what its
/// freedom gains from the formula's own approximations.
constexpr double curve_margin = 4.0, curve_share = 0.05;
/// The same where both are promised by scores, which agree more closely than a score and a refit do; for strong
/// ones what the steps between the starts of a name may lose.
constexpr double score_margin = 2.5, score_share = 0.01;
constexpr double tolerated_noncentrality = 7.0;  ///< below it two effects are twins in this design

double margin_of(const Candidate& name) { return std::max(curve_margin, curve_share * name.evidence); }

/// The effects of a model that another does not have.
Model without(const Model& model, const Model& other) {
  Model rest;
  for (const ActiveEffect& active : model)
    if (!contains(other, active.effect)) rest.push_back(active);
  return rest;
}

}  // namespace

double best_curve(const Battery& battery, const Rates& rates, const std::string& channel) {
  double best = 0.0;
  for (const Question& q : battery.questions)
    if (!q.effect && q.channel == channel)
      best = std::max(best, q.gain - q.dof - std::log(rates.starts(q.family)));
  return best;
}

bool equals_curve(const Candidate& name, double curve) {
  const bool mean = name.fit.model.back().effect->info().kind == EffectKind::mean;
  const bool by_score = mean && !Sides::matter(name.fit.model);
  return name.evidence > curve - margin_of(name) &&
         (!by_score || name.foreseen > curve - std::max(score_margin, score_share * name.evidence));
}

void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result) {
  const Model& best = result.best.fit.model;
  for (const Candidate& rival : ranked) {
    if (result.rivals.size() == 2) return;
    const Model causes = without(best, rival.fit.model), others = without(rival.fit.model, best);
    if (causes.empty() || others.empty()) continue;
    const double gap = result.best.evidence - rival.evidence;
    if (gap > std::max(1.0, options.naming_gap_nats)) continue;
    // A design that separates the two by more than the tolerated noncentrality leaves the gap to decide.
    const double apart =
        separation(rows, result.baseline.state, causes, others, without(rival.fit.model, others));
    const double tolerated = apart > tolerated_noncentrality ? 0.5
                             : apart < 0.0                   ? 1.0
                                                             : options.naming_gap_nats;
    if (gap < tolerated) result.rivals.push_back(rival);
  }
}

}  // namespace rangecal::diagnosis
