// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "calibrate/too_few.hpp"
#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/location.hpp"
#include "diagnosis/outlook.hpp"
#include "diagnosis/places.hpp"
#include "diagnosis/prepared.hpp"
#include "diagnosis/profile_limits.hpp"
#include "diagnosis/report.hpp"
#include "diagnosis/residual_bins.hpp"
#include "diagnosis/search.hpp"
#include "diagnosis/simulation_compare.hpp"
#include "diagnosis/undetermined.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/calibrate/doubts.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::no_mismatch:
      return "no_mismatch";
    case Verdict::explained:
      return "explained";
    case Verdict::unexplained:
      return "unexplained";
    case Verdict::unobservable:
      return "unobservable";
  }
  return "unexplained";
}

namespace diagnosis {
namespace {

/// What a calibration says of alpha: with its sampling error where it states one, else exactly. Throws InputError
/// where the error it states is none.
AlphaPrior alpha_prior_of(const Calibration& calibration) {
  AlphaPrior prior{calibration.alpha, {}};
  if (!calibration.alpha_covariance || calibration.alpha_covariance->isZero(0.0)) return prior;
  std::optional<Eigen::MatrixXd> precision = scaled_inverse(*calibration.alpha_covariance);
  if (!precision)
    throw InputError(
        "the simulation's calibration: covariance is not positive definite (rounded to too few digits?); leave it out to hold "
        "alpha exactly");
  prior.precision = std::move(*precision);
  return prior;
}

/// The layout of the recordings and the model they are simulated by again.
void add_simulation_model(const Rows& rows, std::span<const Recording> recordings,
                          std::span<const Recording> corrected, const SearchResult& found, const Fit* generic,
                          Diagnosis& result) {
  SimulationModel& model = result.simulation;
  model.recordings.assign(recordings.begin(), recordings.end());
  for (const Recording& recording : corrected) model.landmark_read.push_back(recording.readings.landmark);
  model.calibration = result.corrected;
  const bool named = found.verdict == Verdict::explained || found.partial;
  const Fit& fit = generic ? *generic : named ? found.best.fit : found.baseline;
  model.calibration.sigma_s_m.reset();
  if (fit.state.sigma_s_m) model.calibration.sigma_s_m = Estimate{*fit.state.sigma_s_m, std::nullopt};
  if (!generic) return;
  model.calibration = calibration_of(rows, recordings, *generic);
  // It has no name; its changes of the readings stand for it. Grids stay: the readings are rounded at last.
  std::erase_if(model.calibration.effects, [](const auto& effect) {
    const Effect* known = find_effect(effect.first);
    return !known || known->info().kind != EffectKind::grid;
  });
  const RowChanges changes =
      row_changes(rows, cell_geometry(rows, generic->state), without_grids(generic->model));
  Eigen::Index row = 0;
  for (const Recording& recording : corrected) {  // rows are ordered by cell within each recording
    const std::vector<std::size_t> order = row_order(recording);
    const std::size_t count = order.size();
    AddedChange added;
    for (auto [from, to] :
         {std::pair{&changes.range, &added.range_m}, std::pair{&changes.bearing, &added.bearing_rad},
          std::pair{&changes.range_log_variance, &added.range_log_variance},
          std::pair{&changes.bearing_log_variance, &added.bearing_log_variance}}) {
      if (from->squaredNorm() == 0.0) continue;
      to->resize(count);
      for (std::size_t i = 0; i < count; ++i) (*to)[order[i]] = (*from)[row + static_cast<Eigen::Index>(i)];
    }
    row += static_cast<Eigen::Index>(count);
    model.added.push_back(std::move(added));
  }
}

}  // namespace
}  // namespace diagnosis

namespace {

/// A run of a calibration that carries effects: they are simulated, since only curve and noise can be held.
std::vector<Recording> simulated_by(const Calibration& calibration, std::span<const Recording> recordings) {
  SimulationModel model;
  model.recordings.assign(recordings.begin(), recordings.end());
  model.calibration = calibration;
  return simulate(model, seed_from("simulated_by", {}));
}

/// Throws where nothing can be tested: InputError for too few readings, places or cells, NoAnswerError for
/// readings without noise.
void require_testable(const diagnosis::Rows& rows, std::span<const Recording> recordings) {
  constexpr int highest = 4;
  if (rows.size() < 8) {
    const std::string doubt = limit_doubt(recordings);
    throw InputError(recordings[0].path + ": " + to_string(Outcome::too_few_data) +
                     ": fewer than 8 usable readings: nothing can be diagnosed" +
                     (doubt.empty() ? "" : "; " + doubt));
  }
  if (!rows.pairs)
    if (const auto why = why_too_few(rows.problem, 1))
      throw InputError(recordings[0].path + ": " + to_string(Outcome::too_few_data) + ": " + *why);
  const std::optional<int> order = rows.pairs ? std::nullopt : order_without_noise(rows.problem, 1, highest);
  if (order) throw NoAnswerError(without_noise(*order));
}

/// What the recordings leave open of the curve of the model that is stood by: of the seed model, and where a name
/// completes it of that too, whose noise may be far smaller. A simulation's curve is given.
std::optional<diagnosis::Undetermined> still_undetermined(const diagnosis::Rows& rows,
                                                          std::span<const Recording> recordings,
                                                          const diagnosis::SearchResult& found) {
  if (rows.alpha_prior) return std::nullopt;
  std::optional<diagnosis::Undetermined> open = undetermined(rows, recordings, found.baseline);
  if (open && (found.verdict == Verdict::explained || found.partial))
    open = undetermined(rows, recordings, found.best.fit);
  return open;
}

/// Range residuals far too long in the tails for a normal law.
bool outliers_stand_out(const diagnosis::Battery& battery) {
  return std::any_of(battery.questions.begin(), battery.questions.end(), [](const diagnosis::Question& q) {
    return q.channel == "range_tail" && q.shape == "heavy tails" && q.size > 3.0 && q.log_p < -20.0;
  });
}

}  // namespace

Diagnosis diagnose(std::span<const Recording> recordings, const DiagnoseOptions& options) {
  using namespace diagnosis;
  if (std::optional<Prepared> ready = prepared(recordings)) {
    Diagnosis result = diagnose(ready->recordings, options);
    result.notes.insert(result.notes.end(), ready->notes.begin(), ready->notes.end());
    return result;
  }
  if (options.simulation && !options.simulation->effects.empty()) {
    DiagnoseOptions against = options;
    against.simulation.reset();
    return diagnose_against(recordings, simulated_by(*options.simulation, recordings), against);
  }
  std::vector<Recording> corrected(recordings.begin(), recordings.end());
  Bookkeeping known = correct_labels(corrected);
  Rows rows = make_rows(corrected);
  require_testable(rows, recordings);
  if (options.simulation) rows.alpha_prior = alpha_prior_of(*options.simulation);
  const Bookkeeping gaps = find_grids_and_gaps(rows);
  known.model.insert(known.model.end(), gaps.model.begin(), gaps.model.end());
  known.findings.insert(known.findings.end(), gaps.findings.begin(), gaps.findings.end());
  known.notes.insert(known.notes.end(), gaps.notes.begin(), gaps.notes.end());
  known.step_beyond_noise_m = gaps.step_beyond_noise_m;
  SearchResult found = search(rows, known, options);
  // Gross outliers hide a cause from every score. Where nothing explains, look once more with tails that
  // allow them; a step among repeats that are all alike is none.
  if (found.verdict == Verdict::unexplained && !options.force && outliers_stand_out(*found.first) &&
      known.step_beyond_noise_m == 0.0) {
    Bookkeeping with_tails = known;
    with_tails.model.push_back({find_effect("heavy_tails"), Eigen::Vector2d(0.02, 6.0)});
    SearchResult robust = search(rows, with_tails, options);
    const bool better = robust.partial && (!found.partial || robust.best.evidence > found.best.evidence);
    if (robust.verdict == Verdict::explained || better) found = std::move(robust);
  }
  if (options.simulation && !options.force && found.verdict != Verdict::no_mismatch) {
    const std::vector<std::string> curve_alone = curve_mismatch(rows, known, found, options);
    if (!curve_alone.empty()) {
      DiagnoseOptions forced = options;
      forced.force = curve_alone;
      found = search(rows, known, forced);
    }
  }
  if (found.verdict == Verdict::explained || found.partial) {
    if (!found.known.model.empty()) {  // what the search held moves with all the rest
      Fit free = refit(rows, found.best.fit.model, found.best.fit.state, RefitOptions{});
      if (free.ok) found.best.fit = std::move(free);
    }
    add_profile_limits(rows, RefitOptions{}, found.best.fit);
  }
  for (Candidate& rival : found.rivals) add_profile_limits(rows, RefitOptions{}, rival.fit);
  if (std::any_of(known.model.begin(), known.model.end(),
                  [](const ActiveEffect& a) { return a.effect->info().kind == EffectKind::label; })) {
    Rows raw = make_rows(recordings);  // the baseline is that of the labels as recorded
    raw.alpha_prior = rows.alpha_prior;
    const Fit before = refit(raw, {}, found.baseline.state, RefitOptions{});
    if (before.ok) {
      found.baseline.nll = before.nll;
      found.best.gain = before.nll - found.best.fit.nll;
    }
  }
  const std::optional<Undetermined> open = still_undetermined(rows, recordings, found);
  const bool differs = found.verdict != Verdict::no_mismatch;
  // Where landmarks and curve can shift together a score's first order is none: no name is safe.
  if (open && !rows.pairs && !options.force) {
    found.verdict = Verdict::no_mismatch;
    found.partial = false;
    found.rivals.clear();
  }
  Diagnosis result = assemble_report(rows, recordings, found);
  const auto mark_calibrations = [&] {
    if (!open) return;
    mark_undetermined(rows, *open, found.baseline, result.baseline);
    mark_undetermined(rows, *open, found.baseline, result.corrected);
  };
  mark_calibrations();
  if (open && result.verdict == Verdict::no_mismatch) result.verdict = Verdict::unobservable;
  const bool unobservable = result.verdict == Verdict::unobservable;
  if (unobservable && differs)
    result.notes.push_back(
        "the residuals differ from those of the seed model, but no cause is named beside a curve that is open");
  for (Explanation& e : result.explanations)
    e.probability = std::min(e.probability, 1.0);  // of the effects asked for alone
  for (std::string& doubt : doubts(recordings, result.corrected)) result.notes.push_back(std::move(doubt));
  const std::optional<GenericModel> generic = add_generic(rows, found, result);
  add_location(rows, found, generic ? &*generic : nullptr, result);
  const Fit* curve = generic ? &generic->fit : nullptr;
  // What is shown as the completed model: where no curve stands for what a partial name leaves, the name's
  // own.
  const Fit* completed = !curve && found.partial ? &found.best.fit : curve;
  if (options.simulation) compare_noise(*options.simulation, result.corrected, result);
  if (options.held_out && !unobservable) {
    if (options.progress) options.progress("predicting readings held out", 0.8);
    add_held_out(rows, found, completed, result);
  }
  add_residual_bins(rows, found, completed, result);
  place_by_residuals(rows, result.location);
  if (options.progress) options.progress("looking for what could be hidden", 0.9);
  DiagnoseOptions outlook = options;
  if (unobservable) outlook.unseen = outlook.next_experiments = false;  // of a curve that is none
  add_outlook(rows, found, outlook, result);
  add_simulation_model(rows, recordings, corrected, found, curve, result);
  result.sentence = verdict_sentence(result);
  if (open && !unobservable)
    result.sentence += fmt::format(" The calibration itself is not determined: {}.", open->what);
  constexpr std::string_view found_by_search = "Explained by ";
  if (options.force && result.sentence.starts_with(found_by_search))
    result.sentence = fmt::format("Fitted as asked: {} The seed model's residuals have p = {:.2g}.",
                                  result.sentence.substr(found_by_search.size()), result.alarm_p_value);
  if (curve) {  // no name to correct by, but the noise is that of the completed model
    const Calibration of_curve = calibration_of(rows, recordings, *curve);
    result.corrected.alpha = of_curve.alpha;
    result.corrected.alpha_covariance = of_curve.alpha_covariance;
    result.corrected.effects_covariance.reset();  // of the curve without the one that stands for what is left
    result.corrected.noise = of_curve.noise;
    result.corrected.noise_estimates = of_curve.noise_estimates;
    result.corrected.sigma_theta_rad = of_curve.sigma_theta_rad;
    mark_calibrations();
  }
  if (options.simulation && result.verdict == Verdict::no_mismatch)
    result.sentence = "No mismatch: the simulation accounts for this recording within its noise.";
  if (options.progress) options.progress("done", 1.0);
  return result;
}

}  // namespace rangecal
