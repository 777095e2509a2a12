// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/chosen_anew.hpp"

#include <algorithm>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/candidates.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/working_problem.hpp"

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

/// `without` and a curve along the covariate of `before`, as the part asks for one.
Fit with_curve_anew(const Rows& part, const Fit& without, const GenericEffect& before,
                    const RefitOptions& options, OwnedCurves& curves) {
  Question question;
  question.channel = before.info().channel;
  question.covariate = before.info().covariate;
  if (before.basis().wavenumber > 0.0) question.shape = "periodic";
  const WorkingProblem working = working_problem(part, without.model, without.state);
  const Projector projector(part, working, without.state);
  const std::optional<CurveFit> anew = fit_curve(part, projector, without, question, options);
  if (!anew) return without;
  curves.push_back(anew->effect);
  return anew->fit;
}

}  // namespace

Fit chosen_anew(const Rows& part, Fit fitted, const Rates& rates, const RefitOptions& options,
                OwnedCurves& curves) {
  RefitOptions held = options;
  held.settled = static_cast<int>(fitted.model.size());
  const std::size_t effects = fitted.model.size();
  for (std::size_t e = 0, done = 0; done < effects; ++e, ++done) {
    const Effect& effect = *fitted.model[e].effect;
    const auto* curve = dynamic_cast<const GenericEffect*>(&effect);
    if (!curve && !was_chosen(part, effect)) continue;
    Model others = fitted.model;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(e));
    const Fit without = refit(part, others, fitted.state, held);
    if (!without.ok) continue;
    if (curve) {  // the new one stands last, the next effect in its place
      fitted = with_curve_anew(part, without, *curve, options, curves);
      --e;
      continue;
    }
    const Battery battery(part, without.model, without.state, rates, effect);
    std::vector<Height> heights;
    for (const Question& q : battery.questions) heights.emplace_back(q.gain, q.start);
    heights = peaks_of(heights);
    heights.resize(std::min(heights.size(), most_peaks));
    for (auto& [height, start] : heights) {
      Model model = without.model;
      model.insert(model.begin() + static_cast<std::ptrdiff_t>(e), {&effect, std::move(start)});
      Fit trial = refit(part, model, without.state, held);
      if (trial.ok && trial.nll < fitted.nll) fitted = std::move(trial);
    }
  }
  return fitted;
}

}  // namespace rangecal::diagnosis
