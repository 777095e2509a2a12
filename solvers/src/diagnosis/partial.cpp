// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/partial.hpp"

#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "diagnosis/combinations.hpp"
#include "diagnosis/findings.hpp"
#include "diagnosis/rounds.hpp"
#include "diagnosis/rules.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double partial_margin = 15.0;  ///< nats that a name for one channel of two has to earn
/// Of what is left without a name: a name that explains less may be its shadow.
constexpr double shadow_share = 0.5;

/// Nats of tails that are named though something is left, and how many times as much as a free curve they have to explain.
constexpr double outlier_margin = 50.0, clear_of_curves = 3.0;

/// Questions about one channel, its noise, dependence and tails included.
bool is_of_channel(const Question& q, const std::string& channel) { return q.channel.rfind(channel, 0) == 0; }

/// True if a name explains far more than any free curve of its channel does, and what it leaves in the means
/// there is small beside it: a cause beyond doubt, with something of another size behind it.
bool dominates(const Candidate& name, const Battery& battery, const std::string& channel, double curve) {
  return name.evidence > dominant * curve &&
         std::all_of(battery.questions.begin(), battery.questions.end(), [&](const Question& q) {
           return q.channel != channel || q.gain - q.dof < trace_share * name.evidence;
         });
}

/// True if what a name leaves in the means is so much more than what it explains that it may be that cause's
/// shadow: a mismatch of the bearings moves stops, and the ranges with them.
bool may_be_a_shadow(const Candidate& name, const Battery& battery) {
  return std::any_of(battery.questions.begin(), battery.questions.end(), [&](const Question& q) {
    return !q.effect && (q.channel == "range" || q.channel == "bearing") &&
           shadow_share * (q.gain - q.dof) > name.evidence;
  });
}

/// True if a wider law for a share of the readings explains several times what any free curve does, of means or of spreads:
/// outliers beyond doubt, which both would be led astray by.
bool are_outliers(const Candidate& name, const Battery& root) {
  return name.fit.model.back().effect->info().kind == EffectKind::tail && name.evidence > outlier_margin &&
         std::none_of(root.questions.begin(), root.questions.end(), [&](const Question& q) {
           return !q.effect && !q.channel.ends_with("_tail") &&
                  clear_of_curves * (q.gain - q.dof) > name.evidence;
         });
}

}  // namespace

void find_partial(const Rows& rows, const DiagnoseOptions& options, const Battery& root,
                  const std::vector<Candidate>& singles, std::vector<std::unique_ptr<Battery>>& batteries,
                  SearchResult& result) {
  const auto answer_in_part = [&](std::size_t i) {
    result.partial = true;
    result.best = singles[i];
    result.last = std::move(batteries[i]);
    result.left = findings(rows, *result.last, options.alarm_rate);
    add_rivals(rows, options, singles, result);
  };
  if (!batteries.empty() && are_outliers(singles[0], root)) return answer_in_part(0);
  std::set<std::string> asked;
  for (std::size_t i = 0; i < batteries.size(); ++i) {
    const EffectInfo& info = singles[i].fit.model.back().effect->info();
    if (info.kind != EffectKind::mean || (info.channel != "range" && info.channel != "bearing")) continue;
    if (!asked.insert(info.channel).second) continue;  // only the best of a channel can explain it
    const bool left =
        std::any_of(batteries[i]->questions.begin(), batteries[i]->questions.end(), [&](const Question& q) {
          return is_of_channel(q, info.channel) && batteries[i]->corrected(q) < clean_rate;
        });
    const double curve = best_curve(root, result.rates, info.channel);
    const bool complete = !left && equals_curve(singles[i], curve);
    // What a refit gains beyond what the score promised may be its choice among many optima.
    const bool promised = Sides::matter(singles[i].fit.model) || singles[i].foreseen > partial_margin;
    const bool best = std::none_of(singles.begin(), singles.end(), [&](const Candidate& other) {
      return other.fit.model.back().effect->info().kind == EffectKind::mean &&
             other.evidence > singles[i].evidence + options.naming_gap_nats;
    });
    if (singles[i].evidence < partial_margin || !promised || !best ||
        may_be_a_shadow(singles[i], *batteries[i]) ||
        !(complete || dominates(singles[i], *batteries[i], info.channel, curve)))
      continue;
    answer_in_part(i);
    return;
  }
}

}  // namespace rangecal::diagnosis
