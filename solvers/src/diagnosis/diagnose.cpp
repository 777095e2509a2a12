// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "calibrate/scale_choice.hpp"
#include "calibrate/too_few.hpp"
#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/fit_given.hpp"
#include "diagnosis/labels.hpp"
#include "diagnosis/preprocess.hpp"
#include "diagnosis/profile_limits.hpp"
#include "diagnosis/reporting.hpp"
#include "diagnosis/search.hpp"
#include "diagnosis/select/set_search.hpp"
#include "diagnosis/simulation_compare.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {

const char* to_string(Verdict verdict) {
  switch (verdict) {
    case Verdict::no_mismatch:
      return "no_mismatch";
    case Verdict::explained:
      return "explained";
    case Verdict::partly_explained:
      return "partly_explained";
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

/// The simulation's; else as calibrate chooses it, but a spline only where it is asked for, since it would take up what has a name. Of a
/// reciprocal and a spline of one order more, which takes up what offset or shape are off by.
diagnosis::SeedCurve seed_curve(std::span<const Recording> recordings, const DiagnoseOptions& options) {
  diagnosis::SeedCurve seed;
  if (options.simulation) {
    seed.scale = options.simulation->scale;
    return seed;
  }
  if (recordings.empty() || recordings[0].kind != RecordingKind::pairs) {
    if (options.curve) seed.scale.family = *options.curve;  // make_rows refuses all but polynomials
    return seed;
  }
  constexpr int highest = 4;
  CalibrateOptions wanted;
  wanted.curve = options.curve;
  const Recording all = joined(recordings);
  const std::optional<ScaleChoice> chosen = wanted.curve == CurveFamily::spline
                                                ? std::optional(asked_spline(all, wanted))
                                                : reciprocal_due(all, wanted);
  if (chosen) {
    seed.scale = chosen->scale;
    seed.order = std::min(highest, chosen->order + 1);
  }
  return seed;
}

/// Throws where nothing can be tested: InputError for too few readings, places or cells, NoAnswerError for
/// readings without noise.
void require_testable(const diagnosis::Rows& rows, std::span<const Recording> recordings) {
  constexpr int highest = 4;
  if (rows.size() < 8) {
    const std::string warning = range_limit_warning(recordings);
    throw InputError(recordings[0].path + ": " + to_string(Outcome::too_few_data) +
                     ": fewer than 8 usable readings: nothing can be diagnosed" +
                     (warning.empty() ? "" : "; " + warning));
  }
  if (!rows.pairs)
    if (const auto why = why_too_few(rows.problem, 1))
      throw InputError(recordings[0].path + ": " + to_string(Outcome::too_few_data) + ": " + *why);
  const std::optional<int> order = rows.pairs ? std::nullopt : order_without_noise(rows.problem, 1, highest);
  if (order) throw NoAnswerError(without_noise(*order));
}

/// What was asked for, fitted; else what the search finds.
diagnosis::SearchResult looked_for(const diagnosis::Rows& rows, const diagnosis::Bookkeeping& known,
                                   const DiagnoseOptions& options) {
  if (!options.force) return diagnosis::search_by_sets(rows, known, options);
  diagnosis::RefitOptions refit_options;
  diagnosis::SearchResult result = diagnosis::scan_seed_model(rows, known, options, refit_options);
  diagnosis::fit_given(rows, *options.force, refit_options, result);
  return result;
}

}  // namespace

void DiagnoseOptions::check() const {
  if (!(alarm_rate > 0.0 && alarm_rate < 1.0))
    throw InputError(fmt::format("alarm_rate is {}, not between 0 and 1", alarm_rate));
  if (!(naming_gap_nats >= 0.0 && std::isfinite(naming_gap_nats)))
    throw InputError(fmt::format("naming_gap_nats is {}, not 0 or more", naming_gap_nats));
  if (null_draws < 1) throw InputError(fmt::format("null_draws is {}, not 1 or more", null_draws));
  const auto known = [](const char* option, const std::string& id) {
    const Effect* effect = find_effect(id);
    if (effect == nullptr)
      throw InputError(
          fmt::format("{}: no effect is called '{}'; 'rangecal effects' lists them", option, id));
    return effect->info().kind;
  };
  if (force) {
    if (!without.empty())
      throw InputError(
          "without: where the effects are forced nothing is searched, so there is nothing to leave out");
    for (const std::string& id : *force) known("force", id);
  }
  for (const std::string& id : without)
    if (const EffectKind kind = known("without", id);
        kind == EffectKind::label || kind == EffectKind::grid || kind == EffectKind::detection)
      throw InputError(fmt::format("without: {} is found before the search, and cannot be left out", id));
}

Diagnosis diagnose(std::span<const Recording> recordings, const DiagnoseOptions& options) {
  using namespace diagnosis;
  options.check();
  if (std::optional<Preprocessed> preprocessed = preprocess(recordings)) {
    Diagnosis result = diagnose(preprocessed->recordings, options);
    result.notes.insert(result.notes.end(), preprocessed->notes.begin(), preprocessed->notes.end());
    return result;
  }
  if (options.simulation && !options.simulation->effects.empty()) {
    DiagnoseOptions against = options;
    against.simulation.reset();
    return diagnose_against(recordings, simulated_by(*options.simulation, recordings), against);
  }
  std::vector<Recording> corrected(recordings.begin(), recordings.end());
  Bookkeeping known = correct_labels(corrected);
  Rows rows = make_rows(corrected, seed_curve(corrected, options));
  rows.context.left_out = options.without;
  require_testable(rows, recordings);
  if (options.simulation) rows.alpha_prior = alpha_prior_of(*options.simulation);
  const Bookkeeping gaps = find_grids_and_gaps(rows);
  known.model.insert(known.model.end(), gaps.model.begin(), gaps.model.end());
  known.findings.insert(known.findings.end(), gaps.findings.begin(), gaps.findings.end());
  known.notes.insert(known.notes.end(), gaps.notes.begin(), gaps.notes.end());
  known.step_beyond_noise_m = gaps.step_beyond_noise_m;
  known.coarse = gaps.coarse;
  SearchResult found = looked_for(rows, known, options);
  if (!options.force && found.verdict != Verdict::no_mismatch &&
      drop_fine_grids(rows, found.named() ? found.best.fit : found.baseline, known))
    found = looked_for(rows, known, options);
  if (found.named() && add_grid_beside(rows, found.best.fit, known)) found = looked_for(rows, known, options);
  if (options.simulation && !options.force && found.verdict != Verdict::no_mismatch) {
    const std::vector<std::string> curve_alone = curve_mismatch(rows, known, found, options);
    if (!curve_alone.empty()) {
      DiagnoseOptions with_given = options;
      with_given.force = curve_alone;
      found = looked_for(rows, known, with_given);
    }
  }
  if (found.named()) {
    if (!found.known.model.empty()) {  // what the search held moves with all the rest
      Fit free = refit(rows, found.best.fit.model, found.best.fit.state, RefitOptions{});
      if (free.ok) found.best.fit = std::move(free);
    }
    add_profile_limits(rows, RefitOptions{}, found.best.fit);
  }
  for (Candidate& rival : found.rivals) add_profile_limits(rows, RefitOptions{}, rival.fit);
  if (std::any_of(known.model.begin(), known.model.end(),
                  [](const ActiveEffect& a) { return a.effect->info().kind == EffectKind::label; })) {
    Rows raw = make_rows(recordings, rows.curve);  // the baseline is that of the labels as recorded
    raw.alpha_prior = rows.alpha_prior;
    const Fit before = refit(raw, {}, found.baseline.state, RefitOptions{});
    if (before.ok) {
      found.baseline.nll = before.nll;
      found.best.gain = before.nll - found.best.fit.nll;
    }
  }
  Diagnosis result = diagnosis_of(rows, recordings, corrected, found, options);
  if (!options.without.empty())
    result.notes.push_back(
        fmt::format("Left out of the catalogue, as asked: {}.", fmt::join(options.without, ", ")));
  if (options.progress) options.progress("done", 1.0);
  return result;
}

}  // namespace rangecal
