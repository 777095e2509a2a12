// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/fit_given.hpp"

#include "rangecal/core/errors.hpp"

namespace rangecal::diagnosis {

void fit_given(const Rows& rows, const std::vector<std::string>& names, const RefitOptions& options,
               SearchResult& result) {
  if (names.empty()) throw InputError("no effect is named to be fitted");
  const std::vector<Proposal> proposals = propose(rows, *result.first, {});
  for (const std::string& id : names) {
    const Effect* effect = find_effect(id);
    if (!effect) throw InputError("no effect is called '" + id + "'");
    const auto grid = effect->start_grid(rows.context);
    if (grid.empty()) throw InputError("effect '" + id + "' has nothing to act on in this recording");
    Proposal proposal{effect, grid.front(), 0.0, 0.0, {}};
    for (const Proposal& p : proposals)
      if (p.effect == effect) proposal = p;
    for (const Question& q : result.first->questions)
      if (q.effect == effect && q.gain > proposal.predicted_gain)
        proposal = {effect, q.start, q.gain, 0.0, {}};
    const Fit base = result.best.fit.ok ? result.best.fit : result.baseline;
    result.best.fit = fit_proposal(rows, base, proposal, options);
    if (!result.best.fit.ok) throw NoAnswerError("effect '" + id + "' cannot be fitted to this recording");
  }
  result.best.gain = result.baseline.nll - result.best.fit.nll;
  result.best.parameters = static_cast<int>(result.best.fit.free.size());
  result.best.evidence = result.best.gain - result.best.parameters;
  result.verdict = Verdict::explained;
  result.last = std::make_unique<Battery>(rows, result.best.fit.model, result.best.fit.state, result.rates);
}

}  // namespace rangecal::diagnosis
