// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/chosen_anew.hpp"

#include <algorithm>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/bookkeeping.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_peaks = 4;  ///< as many as the search refits of a proposal

/// True if scores over a grid found some parameter of the effect.
bool was_chosen(const Rows& rows, const Effect& effect) {
  const EffectInfo& info = effect.info();
  return !is_bookkeeping(info.kind) &&
         std::any_of(info.parameters.begin(), info.parameters.end(),
                     [](const EffectParameter& p) { return p.discrete || !p.linear; }) &&
         effect.start_grid(rows.context).size() > 1;
}

/// The starts at which the scores are highest along the grid, highest first.
std::vector<Eigen::VectorXd> highest_starts(const std::vector<Question>& asked) {
  std::vector<const Question*> peaks;
  for (std::size_t i = 0; i < asked.size(); ++i) {
    const bool rises = i == 0 || asked[i].gain >= asked[i - 1].gain;
    const bool falls = i + 1 == asked.size() || asked[i].gain > asked[i + 1].gain;
    if (rises && falls) peaks.push_back(&asked[i]);
  }
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const Question* a, const Question* b) { return a->gain > b->gain; });
  peaks.resize(std::min(peaks.size(), most_peaks));
  std::vector<Eigen::VectorXd> starts;
  for (const Question* peak : peaks) starts.push_back(peak->start);
  return starts;
}

}  // namespace

Fit chosen_anew(const Rows& part, Fit fitted, const Rates& rates, const RefitOptions& options) {
  RefitOptions held = options;
  held.settled = static_cast<int>(fitted.model.size());
  for (std::size_t e = 0; e < fitted.model.size(); ++e) {
    const Effect& effect = *fitted.model[e].effect;
    if (!was_chosen(part, effect)) continue;
    Model others = fitted.model;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(e));
    const Fit without = refit(part, others, fitted.state, held);
    if (!without.ok) continue;
    const Battery battery(part, without.model, without.state, rates, effect);
    for (Eigen::VectorXd& start : highest_starts(battery.questions)) {
      Model model = without.model;
      model.insert(model.begin() + static_cast<std::ptrdiff_t>(e), {&effect, std::move(start)});
      Fit trial = refit(part, model, without.state, held);
      if (trial.ok && trial.nll < fitted.nll) fitted = std::move(trial);
    }
  }
  return fitted;
}

}  // namespace rangecal::diagnosis
