// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/refine.hpp"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <set>
#include <utility>
#include <vector>

#include "diagnosis/alternation.hpp"
#include "diagnosis/candidates.hpp"
#include "diagnosis/free_parameters.hpp"
#include "diagnosis/refit_step.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

/// Step of the grid of a parameter that only a grid can find; 0 for labels and numbers of stops, which have
/// nothing in between.
double grid_step(const std::vector<Eigen::VectorXd>& grid, Eigen::Index index) {
  std::set<double> values;
  for (const Eigen::VectorXd& start : grid) values.insert(start[index]);
  double step = 0.0;
  for (auto it = values.begin(); it != values.end(); ++it) {
    if (*it != std::round(*it) && values.size() > 1)
      step = (*values.rbegin() - *values.begin()) / static_cast<double>(values.size() - 1);
  }
  return step;
}

/// Refits from a state whose cells stay at first on the side of a switching distance on which they are: from
/// parameters that are still far off, their readings would carry them back.
Fit refit_from_sides(const Rows& rows, const Model& model, JointState state, const RefitOptions& options) {
  RefitOptions staying = options;
  staying.places_stay = true;
  if (!std::isfinite(calibrate_under(rows, model, state, staying))) return {};
  return refit(rows, model, state, options);
}

/// Groups values of a parameter, in ascending order, between which no cell changes sides: the index of the middle one of its group, of every
/// value. Where an effect jumps elsewhere, or nowhere, every value is a group of its own.
std::vector<std::size_t> with_the_same_sides(const Rows& rows, const Fit& fit, std::size_t member,
                                             Eigen::Index parameter, const std::vector<double>& values) {
  ActiveEffect active = fit.model[member];
  std::vector<double> distances = cell_geometry(rows, fit.state).d;
  std::sort(distances.begin(), distances.end());
  const auto near = [&](double value) {
    active.parameters[parameter] = value;
    return active.effect->switching_distance(active.parameters.data()) == value
               ? std::lower_bound(distances.begin(), distances.end(), value) - distances.begin()
               : -1;
  };
  std::vector<std::size_t> middle(values.size());
  for (std::size_t begin = 0, end = 0; begin < values.size(); begin = end) {
    const auto cells = near(values[begin]);
    for (end = begin + 1; end < values.size() && cells >= 0 && near(values[end]) == cells;) ++end;
    for (std::size_t i = begin; i < end; ++i) middle[i] = begin + (end - begin) / 2;
  }
  return middle;
}

/// Refits of a model with these values of one parameter of a member, from a geometry. A value that is not `wanted` has none.
std::vector<Fit> fits_at(
    const Rows& rows, const Model& model, std::size_t member, Eigen::Index parameter,
    const std::vector<double>& values, const JointState& geometry, const RefitOptions& options,
    const std::function<bool(std::size_t)>& wanted = [](std::size_t) { return true; }) {
  std::vector<Fit> fits(values.size());
  in_parallel(
      values.size(),
      [&](std::size_t i) {
        if (!wanted(i)) return;
        Model trial = model;
        trial[member].parameters[parameter] = values[i];
        fits[i] = refit(rows, trial, geometry, options);
      },
      jobs_at_once(rows.size()));
  return fits;
}

/// Scans such parameters of a member finely around the fit. Their likelihood has steps, one
/// where a reading changes sides; the middle of the highest one is taken, where no reading is about to.
void scan_steps(const Rows& rows, std::size_t member, const RefitOptions& options, Fit& fit) {
  constexpr int reach = 12, parts = 8;
  constexpr double level = 0.3;  // nats within which two values are on the same step
  const ActiveEffect active = fit.model[member];
  const auto& parameters = active.effect->info().parameters;
  const auto grid = active.effect->start_grid(rows.context);
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    const auto index = static_cast<Eigen::Index>(j);
    const double step = parameters[j].discrete ? grid_step(grid, index) / parts : 0.0;
    if (step == 0.0) continue;
    std::vector<double> values;
    for (int i = -reach; i <= reach; ++i) values.push_back(active.parameters[index] + i * step);
    const std::vector<std::size_t> tried = with_the_same_sides(rows, fit, member, index, values);
    const std::vector<Fit> fits =
        fits_at(rows, fit.model, member, index, values, fit.state, roughly(fit, options),
                [&](std::size_t i) { return tried[i] == i; });
    std::vector<const Fit*> scan;
    for (const std::size_t i : tried)
      if (fits[i].ok) scan.push_back(&fits[i]);
    if (scan.empty()) continue;
    const auto best = std::min_element(scan.begin(), scan.end(),
                                       [](const Fit* a, const Fit* b) { return a->nll < b->nll; });
    auto first = best, last = best;
    while (first != scan.begin() && (*std::prev(first))->nll < (*best)->nll + level) --first;
    while (std::next(last) != scan.end() && (*std::next(last))->nll < (*best)->nll + level) ++last;
    const Fit& found = **(first + (last - first) / 2);
    Fit middle = refit(rows, found.model, found.state, options);
    if (middle.ok && middle.nll < fit.nll + level) fit = std::move(middle);
  }
}

/// Tries other labels of a member while that gains, all of a few landmarks, of many stops the one before and the one after: a change that is
/// far beyond the noise moves what is linearised, and the likeliest label with it.
void try_labels(const Rows& rows, std::size_t member, const RefitOptions& options, Fit& fit) {
  constexpr std::size_t few = 8;
  constexpr double level = 0.3;  // nats
  const Effect& effect = *fit.model[member].effect;
  const auto& parameters = effect.info().parameters;
  const auto grid = effect.start_grid(rows.context);
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    const auto index = static_cast<Eigen::Index>(j);
    if (!parameters[j].discrete || grid_step(grid, index) > 0.0) continue;
    std::set<double> labels;
    for (const Eigen::VectorXd& start : grid) labels.insert(start[index]);
    for (bool gains = true; gains;) {
      gains = false;
      const auto own = labels.find(fit.model[member].parameters[index]);
      if (own == labels.end()) break;
      const auto first = labels.size() <= few || own == labels.begin() ? labels.begin() : std::prev(own);
      const auto last =
          labels.size() <= few || std::next(own) == labels.end() ? labels.end() : std::next(own, 2);
      std::vector<double> others;
      std::copy_if(first, last, std::back_inserter(others), [&](double label) { return label != *own; });
      for (Fit& trial : fits_at(rows, fit.model, member, index, others, fit.state, options))
        if (trial.ok && trial.nll < fit.nll - level) fit = std::move(trial), gains = true;
    }
  }
}

/// Starts a member that jumps at a distance anew, beside the others fitted without it: readings on its wrong side have moved stops, landmarks
/// and what else was free to where they look right, and no small move leads back.
void start_anew(const Rows& rows, std::size_t member, const RefitOptions& options, Fit& fit) {
  constexpr std::size_t most_followed = 3;
  constexpr double level = 0.3;  // nats
  const Model others = without(fit.model, member);
  const Fit beside = refit_beside(rows, fit, others, options);
  if (!beside.ok) return;
  const WorkingProblem working = working_problem(rows, beside.model, beside.state);
  const Projector projector(rows, working, beside.state);
  const auto with = [&](const Eigen::VectorXd& start) {
    Model model = beside.model;
    model.insert(model.begin() + static_cast<std::ptrdiff_t>(member), {fit.model[member].effect, start});
    return model;
  };
  const std::vector<Eigen::VectorXd> grid = fit.model[member].effect->start_grid(rows.context);
  std::vector<Height> heights(grid.size());
  in_parallel(
      grid.size(),
      [&](std::size_t i) {
        const Model model = with(grid[i]);
        const auto step = newton_parameters(rows, working, projector, model,
                                            free_parameters(rows, projector, model, options.settled));
        heights[i] = {step ? step->predicted_gain : 0.0, grid[i]};
      },
      jobs_at_once(rows.size()));
  std::vector<Height> peaks = peaks_of(heights);
  if (peaks.size() > most_followed) peaks.resize(most_followed);
  std::vector<Fit> trials(peaks.size());
  in_parallel(
      peaks.size(),
      [&](std::size_t i) { trials[i] = refit(rows, with(peaks[i].second), beside.state, options); },
      jobs_at_once(rows.size()));
  for (Fit& trial : trials)
    if (trial.ok && trial.nll < fit.nll - level) fit = std::move(trial);
}

/// Carries lines of sight near a switching distance over it, one at a time, while that gains: the seed model
/// spread the jump over stops and landmarks, so that some started on the wrong side, where no small move
/// leads back. False if none gained.
bool try_sides(const Rows& rows, const RefitOptions& options, Fit& fit) {
  constexpr int most = 4;
  constexpr double level = 0.3;  // nats
  bool any = false;
  for (int pass = 0; pass < most; ++pass) {
    Fit best = fit;
    const auto others = Sides::others(rows, fit.model, fit.state);
    std::vector<Fit> trials(others.size());
    in_parallel(
        trials.size(),
        [&](std::size_t i) {
          trials[i] = refit_from_sides(rows, others[i].first, others[i].second, as_they_are(fit, options));
        },
        jobs_at_once(rows.size()));
    for (Fit& trial : trials)
      if (trial.ok && trial.nll < best.nll) best = std::move(trial);
    if (!(best.nll < fit.nll - level)) break;
    Fit again = refit(rows, best.model, best.state, options);
    fit = again.ok ? std::move(again) : std::move(best);
    any = true;
  }
  return any;
}

/// Tries the period of an effect that oscillates with distance around the fit, by a quarter of a peak's width: the likelihood
/// has many peaks beside the highest. Each trial starts from the given geometry, not from one that lies on a wrong peak.
void try_periods(const Rows& rows, const JointState& geometry, std::size_t member,
                 const RefitOptions& options, Fit& fit) {
  constexpr int reach = 3;
  constexpr double part = 0.003;
  const auto& parameters = fit.model[member].effect->info().parameters;
  Model unsized = fit.model;
  for (std::size_t j = 0; j < parameters.size(); ++j)
    if (parameters[j].linear) unsized[member].parameters[static_cast<Eigen::Index>(j)] = 0.0;
  for (std::size_t j = 0; j < parameters.size(); ++j) {
    if (parameters[j].linear || parameters[j].discrete) continue;
    const auto index = static_cast<Eigen::Index>(j);
    std::vector<double> values;
    for (int i = -reach; i <= reach; ++i)
      values.push_back(unsized[member].parameters[index] * (1.0 + static_cast<double>(i) * part));
    const std::vector<Fit> trials =
        fits_at(rows, unsized, member, index, values, geometry, as_they_are(fit, options));
    const Fit* best = &fit;
    for (const Fit& trial : trials)
      if (trial.ok && trial.nll < best->nll) best = &trial;
    if (best == &fit) continue;
    if (Fit again = refit(rows, best->model, best->state, options); again.ok) fit = std::move(again);
  }
}

/// True if some effect of the fit changes fast with distance: its likelihood has many peaks.
bool has_effect_slope(const Rows& rows, const Fit& fit) {
  return !working_problem(rows, fit.model, fit.state).problem.cells.effect_slope.empty();
}

}  // namespace

bool has_many_optima(const Effect& effect) {
  const auto& parameters = effect.info().parameters;
  const EffectKind kind = effect.info().kind;
  return (kind == EffectKind::mean || kind == EffectKind::noise) &&
         std::any_of(parameters.begin(), parameters.end(),
                     [](const EffectParameter& p) { return p.discrete || !p.linear; });
}

void refine_member(const Rows& rows, const JointState& geometry, std::size_t member,
                   const RefitOptions& options, Fit& fit) {
  if (Sides::matter({fit.model[member]}) && fit.model.size() > 1) start_anew(rows, member, options, fit);
  scan_steps(rows, member, options, fit);
  try_labels(rows, member, options, fit);
  if (Sides::matter({fit.model[member]}) && try_sides(rows, options, fit))
    scan_steps(rows, member, options, fit);
  if (fit.model[member].effect->info().kind == EffectKind::mean && has_effect_slope(rows, fit))
    try_periods(rows, geometry, member, options, fit);
}

}  // namespace rangecal::diagnosis
