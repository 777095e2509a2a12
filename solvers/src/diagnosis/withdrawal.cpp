// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/withdrawal.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double withdrawing_errors = 2.0;  ///< standard errors by which a name predicts worse

std::optional<HeldOutChange> change_by(const Diagnosis& result, std::size_t explanation) {
  const Explanation& e = result.explanations[explanation];
  if (!result.before.heldout_nll || !e.heldout_nll) return std::nullopt;
  return HeldOutChange{*e.heldout_nll - *result.before.heldout_nll, e.heldout_std};
}

std::string in_nats(const HeldOutChange& change) {
  return fmt::format("held-out readings are predicted worse by {:.1f} +- {:.1f} nats", change.nll,
                     change.std_dev.value_or(0.0));
}

}  // namespace

bool speaks_against(const HeldOutChange& change) {
  return change.std_dev && *change.std_dev > 0.0 && change.nll > withdrawing_errors * *change.std_dev;
}

std::string withdraw_names(const Rows& rows, SearchResult& found, Diagnosis& result) {
  const bool named = found.named();
  // The density held out is that of all that was found: beside bookkeeping it does not judge the name alone.
  if (!named || result.explanations.empty() || !found.known.model.empty()) return {};
  std::vector<std::string> searched;
  for (const ActiveEffect& active : found.best.fit.model)
    if (!is_bookkeeping(active.effect->info().kind)) searched.push_back(active.effect->info().id);
  std::optional<HeldOutChange> change = change_by(result, 0);
  if (searched.empty() || !change) return {};
  if (found.partly() && speaks_against(*change))  // by the name, or by the curve beside it
    change = held_out_change(rows, found, found.best.fit);
  if (change && tells_outcomes())
    tell(fmt::format("names {}: {}, they change the held-out NLL by {:.2f} +- {:.2f} nats",
                     fmt::join(searched, " + "), speaks_against(*change) ? "withdrawn" : "kept", change->nll,
                     change->std_dev.value_or(not_known)));
  if (change && speaks_against(*change)) {
    found.verdict = Verdict::unexplained;
    found.best = {};
    found.rivals.clear();
    found.left.clear();
    found.last.reset();
    return fmt::format("Held-out data speak against {}: with it, {}, so it is not named.",
                       fmt::join(searched, " and "), in_nats(*change));
  }
  for (std::size_t i = result.explanations.size(); i-- > 1;) {
    const std::optional<HeldOutChange> other = change_by(result, i);
    if (!other || !speaks_against(*other)) continue;
    const std::vector<std::string> effects = result.explanations[i].effects;
    result.notes.push_back(fmt::format("held-out data speak against {}, which fits as well: with it, {}",
                                       fmt::join(effects, " and "), in_nats(*other)));
    std::erase(result.explanations[0].indistinguishable_from, effects);
    result.explanations.erase(result.explanations.begin() + static_cast<std::ptrdiff_t>(i));
    if (i - 1 < found.rivals.size())
      found.rivals.erase(found.rivals.begin() + static_cast<std::ptrdiff_t>(i - 1));
  }
  return {};
}

}  // namespace rangecal::diagnosis
