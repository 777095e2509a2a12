// SPDX-License-Identifier: BSD-3-Clause
// Held-out predictive density: fitted on four fifths of the blocks, asked about the last fifth,
//   sum over folds of  l_s(all readings; theta of the rest) - l_s(the rest; theta of the rest),
// stops integrated by Laplace's method in both. Where several recordings are given: held_recordings.hpp.
#include "diagnosis/held_out.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <set>
#include <string>

#include "diagnosis/battery.hpp"
#include "diagnosis/effect_estimates.hpp"
#include "diagnosis/generic.hpp"
#include "diagnosis/held_recordings.hpp"
#include "diagnosis/profile_limits.hpp"
#include "diagnosis/reselection.hpp"
#include "diagnosis/subset.hpp"
#include "diagnosis/training_part.hpp"
#include "in_parallel.hpp"
#include "rangecal/core/blocks.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr int fold_count = 5;
constexpr int parts_of_fold = 8;  ///< groups of blocks whose predictions give the standard error
constexpr int steps_of_fold = 2;  ///< towards the fit to four fifths, from the fit to all

/// True if the errors of the stops add up along the path: a reading then tells of every stop.
bool is_chained(const Rows& rows, const Fit& fit) {
  const auto stops = working_problem(rows, fit.model, fit.state).problem.stops;
  return std::any_of(stops.begin(), stops.end(), [](const StopPrior& prior) { return prior.chained; });
}

/// Marks, beside those of `part`, the cells of all other places: given the calibration, a place's prediction
/// depends on no other.
std::vector<char> elsewhere(const Rows& rows, const std::vector<char>& part) {
  const auto place = [&](std::size_t c) {
    return rows.problem.stops[static_cast<std::size_t>(rows.problem.cells.stop[c])].place;
  };
  std::set<int> ours;
  for (std::size_t c = 0; c < part.size(); ++c)
    if (part[c]) ours.insert(place(c));
  std::vector<char> away(part.size());
  for (std::size_t c = 0; c < part.size(); ++c) away[c] = !ours.count(place(c));
  return away;
}

/// `rates`: of the recording's battery, by which the training parts choose again what was chosen from a grid.
HeldOut predict(const Rows& rows, const std::vector<int>& blocks, const std::vector<int>& folds,
                const Fit& full, const RefitOptions& options, const Rates& rates) {
  std::vector<HeldOut> of_fold(fold_count);
  const bool chained = is_chained(rows, full);
  in_parallel(
      of_fold.size(),
      [&](std::size_t fold) {
        const int f = static_cast<int>(fold);
        HeldOut& held = of_fold[fold];
        std::vector<char> out(folds.size());
        for (std::size_t c = 0; c < folds.size(); ++c) out[c] = folds[c] == f;
        if (std::find(out.begin(), out.end(), 1) == out.end()) return;
        if (std::find(out.begin(), out.end(), 0) == out.end()) {  // nothing to learn from
          held.ok = false;
          return;
        }
        const Rows rest = without_cells(rows, out);
        Fit fit = fit_part(rest, full, options, steps_of_fold);
        OwnedCurves curves;
        if (fit.ok) fit = reselect(rest, std::move(fit), rates, options, curves);
        if (!fit.ok) {
          held.ok = false;
          return;
        }
        const auto value = [&](const Rows& part) {
          JointState state = fit.state;
          return laplace_value(part, fit.model, state);
        };
        const double alone = value(rest);
        add_squares(rows, out, fit.model, fit.state, held);
        // Cells that are never left out belong to the training part of every fold.
        held.nll = value(rows) - alone;
        for (int part = 0; part < parts_of_fold; ++part) {
          std::vector<char> ours(folds.size());
          for (std::size_t c = 0; c < folds.size(); ++c)
            ours[c] = folds[c] == f && (blocks[c] / fold_count) % parts_of_fold == part;
          if (std::find(ours.begin(), ours.end(), 1) == ours.end()) continue;
          const std::vector<char> away = chained ? std::vector<char>(ours.size()) : elsewhere(rows, ours);
          std::vector<char> with = away, without = away;
          for (std::size_t c = 0; c < folds.size(); ++c) {
            with[c] = away[c] || (out[c] && !ours[c]);
            without[c] = away[c] || out[c];
          }
          held.parts.push_back(value(without_cells(rows, with)) -
                               (chained ? alone : value(without_cells(rows, without))));
        }
        held.ok = std::isfinite(held.nll);
      },
      jobs_at_once(rows.size()));
  HeldOut all = sum_of(of_fold);
  all.ok = all.ok && std::any_of(folds.begin(), folds.end(), [](int f) { return f >= 0; });
  return all;
}

}  // namespace

std::optional<GenericModel> add_generic(const Rows& rows, const SearchResult& found, Diagnosis& result) {
  if ((found.verdict != Verdict::unexplained && !found.partly()) || found.shapes.empty() || !found.first)
    return std::nullopt;
  GenericModel generic = fit_generic_model(rows, found, RefitOptions{});
  if (!generic.effect) return std::nullopt;
  add_profile_limits(rows, RefitOptions{}, generic.fit);
  const Battery battery = Battery::of_nothing(rows, generic.fit.model, generic.fit.state, found.rates);
  const Projector& projector = battery.projector();
  result.after.nll = generic.fit.nll;
  result.after.rms_range_m = std::sqrt(projector.range_residual.squaredNorm() / rows.cell_count);
  result.after.rms_bearing_rad = std::sqrt(projector.bearing_residual.squaredNorm() / rows.cell_count);
  if (result.explanations.empty()) result.explanations.emplace_back();
  Explanation& explanation = result.explanations[0];
  explanation.nll = generic.fit.nll;
  explanation.parameters = effect_estimates(rows, generic.fit);
  const double price = 2.0 * generic.curve.gain;
  explanation.p_value = found.rates.corrected(
      (found.partly() && !found.left.empty() ? found.left : found.shapes).front().family,
      log_chi_sq_survival(price, std::max(1, static_cast<int>(generic.fit.free.size()))));
  const double taken =
      generic.effect->info().kind == EffectKind::mean ? static_cast<double>(generic.fit.free.size()) : 0.0;
  result.after.chi_sq_per_dof = battery.cell_chi_sq / std::max(1.0, found.first->cell_dof - taken);
  return generic;
}

namespace {

/// Standard error of the difference of two predictions, from those of groups of blocks; none for fewer than two.
std::optional<double> std_of_difference(const HeldOut& before, const HeldOut& after) {
  const std::size_t parts = std::min(before.parts.size(), after.parts.size());
  if (parts < 2) return std::nullopt;
  double mean = 0.0, square = 0.0;
  for (std::size_t i = 0; i < parts; ++i)
    mean += (after.parts[i] - before.parts[i]) / static_cast<double>(parts);
  for (std::size_t i = 0; i < parts; ++i) square += std::pow(after.parts[i] - before.parts[i] - mean, 2);
  return std::sqrt(square * static_cast<double>(parts) / static_cast<double>(parts - 1));
}

std::optional<double> rms_of(const HeldOut& held) {
  if (!(held.cells > 0.0)) return std::nullopt;
  return std::sqrt(held.squares / held.cells);
}

/// Predictions of the same blocks by several fits.
struct Predictions {
  std::vector<HeldOut> of_fit;
  std::string blocks, note;  ///< what was left out; where several recordings are given, why
  double effective = 0.0;    ///< blocks, see effective_blocks
};

/// Fills `all` by whole recordings, if there are several and each fit can be asked about them; else says why not.
bool predict_by_recordings(const Rows& rows, const SearchResult& found, const std::vector<const Fit*>& fits,
                           Predictions& all) {
  if (recordings_with_readings(rows) < 2) return false;
  std::string why_not;
  for (const Fit* fit : fits)
    if (why_not.empty()) why_not = why_not_whole_recordings(rows, fit->model);
  if (why_not.empty()) {
    in_parallel(
        fits.size(),
        [&](std::size_t i) {
          all.of_fit[i] = predict_recordings(rows, *fits[i], found.rates, RefitOptions{});
        },
        jobs_at_once(rows.size()));
    if (std::all_of(all.of_fit.begin(), all.of_fit.end(), [](const HeldOut& held) { return held.ok; })) {
      std::vector<int> recording;
      for (const int cell : rows.cell)
        recording.push_back(recording_of(rows, static_cast<std::size_t>(cell)));
      all.blocks = "recordings";
      all.effective = effective_blocks(recording);
      all.note = whole_recordings_in_words(rows);
      return true;
    }
    why_not = "without one, the others do not determine a calibration that predicts it";
  }
  all.note = fmt::format("held out: {} of all recordings, not whole recordings: {}", rows.blocks, why_not);
  return false;
}

/// The fit without each of its members.
std::vector<Fit> fits_without(const Rows& rows, const Fit& fit, const std::vector<Member>& members) {
  std::vector<Fit> without(members.size());
  in_parallel(
      members.size(),
      [&](std::size_t i) {
        Model model = fit.model;
        std::erase_if(model, [&](const ActiveEffect& a) { return a.effect->info().id == members[i].effect; });
        without[i] = refit_beside(rows, fit, model, RefitOptions{});
      },
      jobs_at_once(rows.size()));
  return without;
}

/// By whole recordings, else by the blocks of the rows.
Predictions predict_all(const Rows& rows, const SearchResult& found, const std::vector<const Fit*>& fits) {
  RefitOptions refit_options;
  refit_options.gradient_tolerance = close_enough;
  Predictions all;
  all.of_fit.resize(fits.size());
  if (predict_by_recordings(rows, found, fits, all)) return all;
  all.blocks = rows.blocks;
  all.effective = effective_blocks(rows.block);
  const std::vector<int> blocks = blocks_of_cells(rows);
  const std::vector<int> folds = folds_of(rows, blocks, fold_count);
  in_parallel(
      fits.size(),
      [&](std::size_t i) {
        all.of_fit[i] = predict(rows, blocks, folds, *fits[i], refit_options, found.rates);
      },
      jobs_at_once(rows.size()));
  return all;
}

}  // namespace

std::optional<HeldOutChange> held_out_change(const Rows& rows, const SearchResult& found, const Fit& fit) {
  return held_out_change(rows, found, found.baseline, fit);
}

std::optional<HeldOutChange> held_out_change(const Rows& rows, const SearchResult& found, const Fit& other,
                                             const Fit& fit) {
  const std::vector<HeldOut> held = predict_all(rows, found, {&other, &fit}).of_fit;
  if (!held[0].ok || !held[1].ok) return std::nullopt;
  return HeldOutChange{held[1].nll - held[0].nll, std_of_difference(held[0], held[1])};
}

void add_held_out(const Rows& rows, const SearchResult& found, const Fit* completed, Diagnosis& result) {
  const bool explained = found.verdict == Verdict::explained;
  const Fit* final_fit = explained ? &found.best.fit : completed;
  std::vector<const Fit*> fits{&found.baseline};
  if (final_fit) fits.push_back(final_fit);
  if (explained)
    for (const Candidate& rival : found.rivals) fits.push_back(&rival.fit);
  const std::size_t first_without = fits.size();
  const std::vector<Fit> without =
      final_fit ? fits_without(rows, *final_fit, result.members) : std::vector<Fit>{};
  std::vector<std::size_t> of_member;  // of the fits that follow
  for (std::size_t i = 0; i < without.size(); ++i)
    if (without[i].ok) fits.push_back(&without[i]), of_member.push_back(i);
  const Predictions predictions = predict_all(rows, found, fits);
  const std::vector<HeldOut>& held = predictions.of_fit;
  const HeldOut& before = held[0];
  if (!before.ok) return;
  result.heldout_blocks = predictions.blocks;
  result.heldout_effective_blocks = predictions.effective;
  if (!predictions.note.empty()) result.notes.push_back(predictions.note);
  result.before.heldout_nll = before.nll;
  result.before.heldout_std = 0.0;
  result.before.heldout_rms_range_m = rms_of(before);
  if (!final_fit) {
    result.after.heldout_rms_range_m = result.before.heldout_rms_range_m;
    result.after.heldout_nll = before.nll;
    result.after.heldout_std = 0.0;
    for (Explanation& e : result.explanations) e.heldout_nll = before.nll, e.heldout_std = 0.0;
    return;
  }
  for (std::size_t i = 0; i < of_member.size(); ++i)
    if (held[first_without + i].ok)
      result.members[of_member[i]].heldout_nll_without = held[first_without + i].nll;
  for (std::size_t i = 1; i < first_without && i <= result.explanations.size(); ++i) {
    if (!held[i].ok) continue;
    result.explanations[i - 1].heldout_nll = held[i].nll;
    result.explanations[i - 1].heldout_std = std_of_difference(before, held[i]);
  }
  if (!held[1].ok) return;
  result.after.heldout_nll = held[1].nll;
  result.after.heldout_rms_range_m = rms_of(held[1]);
  result.after.heldout_std = std_of_difference(before, held[1]);
}

}  // namespace rangecal::diagnosis
