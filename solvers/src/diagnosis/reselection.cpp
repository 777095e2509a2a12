// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/reselection.hpp"

#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/candidates.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/refine.hpp"
#include "diagnosis/working_problem.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_peaks = 4;  ///< as many as the search refits of a proposal

/// True if scores over a grid found where the effect's parameters are best; those of tails and of dependence have one optimum, which a
/// fit to the part finds from the one of all.
bool was_chosen(const Rows& rows, const Effect& effect) {
  return has_many_optima(effect) && effect.start_grid(rows.context).size() > 1;
}

/// Without the curve, and with one along its covariate as the part asks for it. `held`: as `options`, names settled.
Fit with_reselected_curve(const Rows& part, Fit fitted, const GenericEffect& curve, const RefitOptions& held,
                          const RefitOptions& options, OwnedCurves& curves) {
  Model others = fitted.model;
  std::erase_if(others, [&](const ActiveEffect& active) { return active.effect == &curve; });
  Fit without = refit_beside(part, fitted, others, held);
  if (!without.ok) return fitted;
  Question question;
  question.channel = curve.info().channel;
  question.covariate = curve.info().covariate;
  if (curve.basis().wavenumber > 0.0) question.shape = "periodic";
  const WorkingProblem working = working_problem(part, without.model, without.state);
  const Projector projector(part, working, without.state);
  std::optional<CurveFit> anew = fit_curve(part, projector, without, question, options);
  if (!anew) return without;
  curves.push_back(anew->effect);
  return std::move(anew->fit);
}

}  // namespace

Fit reselect(const Rows& part, Fit fitted, const Rates& rates, const RefitOptions& options,
             OwnedCurves& curves) {
  const RefitOptions held = as_they_are(fitted, options), rough = roughly(fitted, options);
  for (std::size_t e = 0; e < fitted.model.size(); ++e) {
    const Effect& effect = *fitted.model[e].effect;
    if (!was_chosen(part, effect)) continue;
    Model others = fitted.model;
    others.erase(others.begin() + static_cast<std::ptrdiff_t>(e));
    const Fit without = refit_beside(part, fitted, others, rough);
    if (!without.ok) continue;
    const Battery battery = Battery::of_nothing(part, without.model, without.state, rates);
    Fit best;
    for (auto& [height, start] : peaks_of(battery, effect, most_peaks)) {
      Model model = without.model;
      model.insert(model.begin() + static_cast<std::ptrdiff_t>(e), {&effect, std::move(start)});
      Fit trial = refit(part, model, without.state, rough);
      if (trial.ok && (!best.ok || trial.nll < best.nll)) best = std::move(trial);
    }
    if (!best.ok || !(best.nll < fitted.nll)) continue;
    Fit trial = refit(part, best.model, best.state, held);
    if (trial.ok && trial.nll < fitted.nll) fitted = std::move(trial);
  }
  const Model chosen = fitted.model;
  for (const ActiveEffect& active : chosen)
    if (const auto* curve = dynamic_cast<const GenericEffect*>(active.effect))
      fitted = with_reselected_curve(part, std::move(fitted), *curve, held, options, curves);
  return fitted;
}

}  // namespace rangecal::diagnosis
