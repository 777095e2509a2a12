// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/simulation_compare.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

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

/// The simulation departs from the seed model: what both share is taken out reading by reading.
Diagnosis diagnose_difference(std::span<const Recording> recordings, std::span<const Recording> simulation,
                              std::span<const Recording> differences, const DiagnoseOptions& of_difference,
                              const DiagnoseOptions& options) {
  Diagnosis result = diagnose(differences, of_difference);
  result.notes.insert(result.notes.begin(),
                      "the simulation departs from the seed model itself; the recording was compared with it "
                      "reading by reading");
  if (result.verdict == Verdict::no_mismatch || options.force) return result;
  // Noise, tails, dependence and grids do not cancel in a difference: they are a mismatch only if the
  // simulation lacks them.
  const auto cancels = [](const std::string& id) {
    const Effect* effect = find_effect(id);
    return effect && effect->info().kind == EffectKind::mean;
  };
  const std::string channel = result.location.empty() ? "" : result.location[0].channel;
  const bool generic = std::find(result.final_effects.begin(), result.final_effects.end(), "generic") !=
                       result.final_effects.end();
  if ((generic && (channel == "range" || channel == "bearing")) ||
      std::any_of(result.final_effects.begin(), result.final_effects.end(), cancels))
    return result;
  DiagnoseOptions alone = options;
  alone.simulation.reset();
  alone.held_out = alone.unseen = alone.next_experiments = false;
  const Diagnosis of_simulation = diagnose(simulation, alone), of_recording = diagnose(recordings, alone);
  std::set<std::string> shared(of_simulation.final_effects.begin(), of_simulation.final_effects.end());
  for (const Explanation& e : of_simulation.explanations) shared.insert(e.effects.begin(), e.effects.end());
  const bool all_shared = of_recording.verdict != Verdict::unobservable &&
                          std::all_of(of_recording.final_effects.begin(), of_recording.final_effects.end(),
                                      [&](const std::string& id) {
                                        if (shared.count(id) > 0 || cancels(id)) return true;
                                        const Effect* effect = find_effect(id);
                                        if (!effect) return false;
                                        const std::optional<double> log_p = log_p_of(
                                            simulation, {id}, alone, effect->info().parameters.size());
                                        return log_p && *log_p < std::log(confirm_rate);
                                      });
  if (all_shared) acquit(result, "what departs from the seed model is in the simulation too");
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
