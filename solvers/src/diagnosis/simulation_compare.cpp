// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/simulation_compare.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "diagnosis/fit_given.hpp"
#include "diagnosis/preprocess.hpp"
#include "diagnosis/report.hpp"
#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace diagnosis {
namespace {

/// Labels of landmarks and stops, for messages and to match layouts.
template <typename Items>
std::set<std::string> labels_of(const Items& items) {
  std::set<std::string> labels;
  for (const auto& item : items) labels.insert(item.label);
  return labels;
}

/// The seed model fitted to recordings.
struct SeedFit {
  Rows rows;
  Fit fit;
  Calibration calibration;
};

SeedFit seed_fit(std::span<const Recording> recordings, const DiagnoseOptions& options) {
  SeedFit s;
  s.rows = make_rows(recordings);
  RefitOptions refit_options;
  DiagnoseOptions own = options;
  own.simulation.reset();
  s.fit = fit_baseline(s.rows, own, refit_options);
  s.calibration = calibration_of(s.rows, recordings, s.fit);
  return s;
}

/// The seed model is all there is in them.
bool is_clean(const SeedFit& s, const DiagnoseOptions& options) {
  Battery battery(s.rows, {}, s.fit.state);
  battery.calibrate(options.null_draws, 1);
  return battery.alarm_p() >= options.alarm_rate && find_grids_and_gaps(s.rows).model.empty();
}

void check_labels(std::span<const Recording> recordings, std::span<const Recording> simulation) {
  if (simulation.empty() || recordings.empty()) throw InputError("--simulation: no recording given");
  if (recordings[0].kind != simulation[0].kind)
    throw InputError(simulation[0].path + ": a simulation of another kind than " + recordings[0].path);
  if (recordings[0].kind == RecordingKind::pairs) return;
  const std::set<std::string> known = labels_of(simulation[0].landmarks);
  for (const Landmark& landmark : recordings[0].landmarks)
    if (!known.count(landmark.label))
      throw InputError(simulation[0].path + ": the simulation has no landmark '" + landmark.label +
                       "', which " + recordings[0].path + " has");
}

/// A diagnosis that says: alike.
void acquit(Diagnosis& result, const std::string& note) {
  result.verdict = Verdict::no_mismatch;
  result.location.clear();
  result.explanations.clear();
  result.final_effects.clear();
  result.after = result.before;
  result.corrected = result.baseline;
  result.notes.insert(result.notes.begin(), note);
  result.sentence = "No mismatch: the simulation accounts for this recording within its noise.";
}

constexpr double confirm_rate = 0.01;  ///< of the one question whether a finding is in both

/// The recordings' noise level against the simulation's where nothing else is amiss, each by the seed model:
/// what both share inflates both alike.
void compare_noise_levels(std::span<const Recording> recordings, const Calibration& simulation,
                          const DiagnoseOptions& options, Diagnosis& result) {
  if (result.verdict != Verdict::no_mismatch) return;
  compare_noise(simulation, seed_fit(recordings, options).calibration, result);
  if (result.verdict != Verdict::no_mismatch) result.sentence = verdict_sentence(result);
}

/// ln p of the effects' gain, fitted to one recording whatever the battery says; none where they cannot be
/// fitted.
std::optional<double> log_p_of(std::span<const Recording> recordings, const std::vector<std::string>& effects,
                               const DiagnoseOptions& options, std::size_t parameters) {
  DiagnoseOptions with_given = options;
  with_given.force = effects;
  with_given.without.clear();
  with_given.held_out = with_given.unseen = with_given.next_experiments = false;
  with_given.progress = nullptr;
  with_given.null_draws = 20;
  try {
    const Diagnosis d = diagnose(recordings, with_given);
    if (d.explanations.empty()) return std::nullopt;
    return log_chi_sq_survival(2.0 * std::max(0.0, d.before.nll - d.explanations.at(0).nll),
                               static_cast<int>(std::max<std::size_t>(1, parameters)));
  } catch (const InputError&) {
    return std::nullopt;
  }
}

/// The seed model with these effects, fitted to recordings.
struct GivenFit {
  Fit fit;
  int parameters = 0;    ///< of the curve, the noise and the effects: what recordings of one sensor share
  double alarm_p = 1.0;  ///< of what is left
};

GivenFit fit_effects(std::span<const Recording> recordings, const std::vector<std::string>& effects,
                     const DiagnoseOptions& options) {
  const Rows rows = make_rows(recordings);
  const Bookkeeping known = find_grids_and_gaps(rows);
  RefitOptions refit_options;
  SearchResult result = scan_seed_model(rows, known, options, refit_options);
  if (!effects.empty()) fit_given(rows, effects, refit_options, result);
  GivenFit given;
  given.fit = effects.empty() ? std::move(result.baseline) : std::move(result.best.fit);
  given.alarm_p = effects.empty() ? result.alarm_p : result.last->alarm_p();
  const JointState& state = given.fit.state;
  given.parameters =
      static_cast<int>(state.alpha.size() + state.noise.parameters.size()) + (rows.reads_bearings() ? 1 : 0);
  for (const ActiveEffect& active : given.fit.model)
    given.parameters += static_cast<int>(active.parameters.size());
  return given;
}

/// The simulation departs from the seed model: what both share is taken out reading by reading.
Diagnosis diagnose_difference(std::span<const Recording> recordings, std::span<const Recording> simulation,
                              std::span<const Recording> differences, const DiagnoseOptions& of_difference,
                              const DiagnoseOptions& options) {
  Diagnosis result = diagnose(differences, of_difference);
  result.notes.insert(result.notes.begin(),
                      "the simulation departs from the seed model itself; the recording was compared with it "
                      "reading by reading");
  if (result.verdict == Verdict::no_mismatch || options.force) return result;
  if (one_model_accounts_for(recordings, simulation, options))
    acquit(result, "what departs from the seed model is in the simulation too");
  return result;
}

Diagnosis compared(std::span<const Recording> recordings, std::span<const Recording> simulation,
                   const DiagnoseOptions& options) {
  check_labels(recordings, simulation);
  const SeedFit fitted = seed_fit(simulation, options);
  const bool clean = is_clean(fitted, options);
  std::vector<Recording> differences;
  int first_stop = 0, first_landmark = 0;
  if (recordings.size() == simulation.size())
    for (std::size_t r = 0; r < recordings.size(); ++r) {
      std::optional<Recording> difference =
          paired(recordings[r], simulation[r], fitted.rows, fitted.fit.state, first_stop, first_landmark);
      if (!difference) break;
      differences.push_back(std::move(*difference));
      first_stop += static_cast<int>(simulation[r].stops.size());
      first_landmark += static_cast<int>(simulation[r].landmarks.size());
    }
  const bool match = differences.size() == recordings.size();
  DiagnoseOptions against = options;
  against.simulation = fitted.calibration;
  DiagnoseOptions of_difference = options;  // the simulation's sampling error is in the readings' spread
  of_difference.simulation = fitted.calibration;
  of_difference.simulation->alpha_covariance.reset();
  for (Estimate& estimate : of_difference.simulation->noise_estimates)
    estimate.std_dev = 1e6 * estimate.value;  // levels are compared afterwards
  of_difference.simulation->noise.parameters *= std::numbers::sqrt2;
  of_difference.simulation->sigma_theta_rad.reset();

  if (clean || !match) {
    Diagnosis result = diagnose(recordings, against);
    if (!clean)
      result.notes.insert(result.notes.begin(),
                          "the simulation departs from the seed model itself, and its layout is not the "
                          "recording's: what both share may be named");
    if (result.verdict == Verdict::no_mismatch || !match || options.force) return result;
    if (result.verdict == Verdict::explained) {
      // A weak effect can hide in the simulation: what the recording shows must also be in the difference.
      const bool of_mean =
          std::all_of(result.final_effects.begin(), result.final_effects.end(), [](const std::string& id) {
            const Effect* effect = find_effect(id);
            return effect && effect->info().kind == EffectKind::mean;
          });
      const std::size_t parameters = result.explanations[0].parameters.size();
      const std::optional<double> log_p =
          of_mean ? log_p_of(differences, result.final_effects, of_difference, parameters) : std::nullopt;
      if (log_p && *log_p > std::log(confirm_rate))
        acquit(result, "what departs from the seed model is in the simulation too");
      else if (!of_mean) {
        DiagnoseOptions alone = options;
        alone.simulation.reset();
        const std::optional<double> there = log_p_of(simulation, result.final_effects, alone, parameters);
        if (there && *there < std::log(confirm_rate))
          acquit(result, "what departs from the seed model is in the simulation too");
      }
    }
    return result;
  }

  Diagnosis result = diagnose_difference(recordings, simulation, differences, of_difference, options);
  if (!options.force) compare_noise_levels(recordings, fitted.calibration, options, result);
  return result;
}

/// Whose note it is stands before it.
void add_note_of_simulation(const std::string& note, Diagnosis& result) {
  std::string said = "of the simulation: " + note;
  if (std::find(result.notes.begin(), result.notes.end(), said) == result.notes.end())
    result.notes.push_back(std::move(said));
}

/// What the readers noted of the simulation.
void add_notes_of_simulation(std::span<const Recording> simulation, Diagnosis& result) {
  for (const Recording& recording : simulation)
    for (const std::string& note : recording.notes) add_note_of_simulation(note, result);
}

}  // namespace

bool one_model_accounts_for(std::span<const Recording> recordings, std::span<const Recording> simulation,
                            const DiagnoseOptions& options) {
  DiagnoseOptions alone = options;
  alone.simulation.reset();
  alone.progress = nullptr;
  alone.held_out = alone.unseen = alone.next_experiments = false;
  const Diagnosis found = diagnose(recordings, alone);
  if (found.verdict != Verdict::explained && found.verdict != Verdict::no_mismatch) return false;
  std::vector<std::string> effects;  // those that are searched for; the others are found again
  for (const std::string& id : found.final_effects) {
    const Effect* effect = find_effect(id);
    if (!effect) return false;
    if (!is_bookkeeping(effect->info().kind)) effects.push_back(id);
  }
  std::vector<Recording> both(recordings.begin(), recordings.end());
  both.insert(both.end(), simulation.begin(), simulation.end());
  try {
    const GivenFit shared = fit_effects(both, effects, alone);
    if (shared.alarm_p < options.alarm_rate) return false;
    const double cost = shared.fit.nll - fit_effects(recordings, effects, alone).fit.nll -
                        fit_effects(simulation, effects, alone).fit.nll;
    return log_chi_sq_survival(2.0 * std::max(0.0, cost), shared.parameters) > std::log(confirm_rate);
  } catch (const InputError&) {
    return false;
  }
}

}  // namespace diagnosis

Diagnosis diagnose_against(std::span<const Recording> recordings, std::span<const Recording> simulation,
                           const DiagnoseOptions& options) {
  using namespace diagnosis;
  if (std::optional<Preprocessed> preprocessed = preprocess(recordings)) {
    Diagnosis result = diagnose_against(preprocessed->recordings, simulation, options);
    result.notes.insert(result.notes.end(), preprocessed->notes.begin(), preprocessed->notes.end());
    return result;
  }
  const std::optional<Preprocessed> preprocessed = preprocess(simulation);
  if (preprocessed) simulation = preprocessed->recordings;
  Diagnosis result = compared(recordings, simulation, options);
  add_notes_of_simulation(simulation, result);
  if (preprocessed)
    for (const std::string& note : preprocessed->notes) add_note_of_simulation(note, result);
  return result;
}

}  // namespace rangecal
