// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/fit_given.hpp"

#include <algorithm>

#include "diagnosis/refine.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::diagnosis {
namespace {

const Effect* effect_of(const Rows& rows, const std::string& id) {
  const Effect* effect = find_effect(id);
  if (!effect) throw InputError("no effect is called '" + id + "'");
  if (effect->start_grid(rows.context).empty())
    throw InputError("effect '" + id + "' has nothing to act on in this recording");
  return effect;
}

/// Where the residuals of a fit make an effect start, and the gain that they promise.
Proposal proposal_of(const Rows& rows, const Battery& battery, const std::vector<Proposal>& proposals,
                     const Effect* effect) {
  Proposal best{effect, effect->start_grid(rows.context).front(), 0.0, 0.0, {}};
  for (const Proposal& p : proposals)
    if (p.effect == effect) best = p;
  for (const Question& q : battery.questions)
    if (q.effect == effect && q.gain > best.predicted_gain) best = {effect, q.start, q.gain, 0.0, {}};
  return best;
}

}  // namespace

void fit_given(const Rows& rows, const std::vector<std::string>& names, const RefitOptions& options,
               SearchResult& result) {
  if (names.empty()) throw InputError("no effect is named to be fitted");
  std::vector<const Effect*> left;
  for (const std::string& id : names) left.push_back(effect_of(rows, id));
  Fit fit = result.best.fit.ok ? result.best.fit : result.baseline;
  const JointState geometry = fit.state;
  std::unique_ptr<Battery> of_fit;  // none: the seed model's
  while (!left.empty()) {           // the one that promises most first: where the next start depends on it
    const Battery& battery = of_fit ? *of_fit : *result.first;
    const std::vector<Proposal> proposals = propose(rows, battery, fit.model);
    std::vector<Proposal> each;
    for (const Effect* effect : left) each.push_back(proposal_of(rows, battery, proposals, effect));
    const auto next = std::max_element(each.begin(), each.end(), [](const Proposal& a, const Proposal& b) {
      return a.predicted_gain < b.predicted_gain;
    });
    fit = fit_proposal(rows, fit, *next, options);
    if (!fit.ok)
      throw NoAnswerError("effect '" + next->effect->info().id + "' cannot be fitted to this recording");
    left.erase(left.begin() + (next - each.begin()));
    if (!left.empty()) of_fit = std::make_unique<Battery>(rows, fit.model, fit.state, result.rates);
  }
  for (std::size_t i = result.baseline.model.size(); i < fit.model.size(); ++i)
    if (has_many_optima(*fit.model[i].effect)) refine_member(rows, geometry, i, options, fit);
  result.best.fit = std::move(fit);
  result.best.gain = result.baseline.nll - result.best.fit.nll;
  result.best.parameters = static_cast<int>(result.best.fit.free.size());
  result.best.evidence = result.best.gain - result.best.parameters;
  result.verdict = Verdict::explained;
  result.last = std::make_unique<Battery>(rows, result.best.fit.model, result.best.fit.state, result.rates);
}

}  // namespace rangecal::diagnosis
