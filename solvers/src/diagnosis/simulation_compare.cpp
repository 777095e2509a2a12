// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/simulation_compare.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <tuple>

#include "diagnosis/location.hpp"
#include "diagnosis/prepared.hpp"
#include "diagnosis/report.hpp"
#include "rangecal/core/angles.hpp"
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

/// Geometry of (stop, landmark) under a fit, by labels of one recording.
struct Predicted {
  double f = 0.0, bearing = 0.0;
};

/// Rank of every reading within its (stop, landmark).
std::vector<int> ranks(const Readings& r) {
  std::map<std::pair<int, int>, int> seen;
  std::vector<int> rank;
  for (std::size_t i = 0; i < r.size(); ++i) rank.push_back(seen[{r.stop[i], r.landmark[i]}]++);
  return rank;
}

bool near(const Recording& recording, const Stop& a, const Stop& b) {
  const double sigma = std::max({0.01, 3.0 * sigma_xy_of(recording, a)});
  const double turn = std::max(0.01, 3.0 * sigma_heading_of(recording, a));
  return std::hypot(a.commanded.x_m - b.commanded.x_m, a.commanded.y_m - b.commanded.y_m) < sigma &&
         std::abs(wrap_angle(a.commanded.heading_rad - b.commanded.heading_rad)) < turn;
}

}  // namespace

std::optional<Recording> paired(const Recording& recording, const Recording& simulation,
                                const Rows& simulation_rows, const JointState& state, int first_stop,
                                int first_landmark) {
  if (recording.kind == RecordingKind::pairs) return std::nullopt;
  std::map<std::string, int> stop_of, landmark_of;
  for (std::size_t k = 0; k < simulation.stops.size(); ++k)
    stop_of[simulation.stops[k].label] = static_cast<int>(k);
  for (std::size_t l = 0; l < simulation.landmarks.size(); ++l)
    landmark_of[simulation.landmarks[l].label] = static_cast<int>(l);
  for (const Stop& stop : recording.stops) {
    const auto other = stop_of.find(stop.label);
    if (other == stop_of.end() || !near(recording, stop, simulation.stops[other->second]))
      return std::nullopt;
  }
  const CellGeometry geometry = cell_geometry(simulation_rows, state);
  const Cells& cells = simulation_rows.problem.cells;
  std::map<std::pair<int, int>, Predicted> predicted;
  for (int c = 0; c < simulation_rows.cell_count; ++c)
    predicted[{cells.stop[c] - first_stop, cells.landmark[c] - first_landmark}] = {geometry.f[c],
                                                                                   geometry.bearing[c]};
  std::map<std::tuple<int, int, int>, std::size_t> partner;
  const std::vector<int> simulation_rank = ranks(simulation.readings), rank = ranks(recording.readings);
  for (std::size_t i = 0; i < simulation.readings.size(); ++i)
    partner[{simulation.readings.stop[i], simulation.readings.landmark[i], simulation_rank[i]}] = i;

  Recording difference = recording;
  const double root2 = std::numbers::sqrt2;
  difference.sigma_xy_m *= root2;
  difference.sigma_heading_rad *= root2;
  for (Stop& stop : difference.stops) {
    stop.commanded = state.stops[first_stop + stop_of[stop.label]];
    if (stop.sigma_xy_m) *stop.sigma_xy_m *= root2;
    if (stop.sigma_heading_rad) *stop.sigma_heading_rad *= root2;
    if (stop.covariance) *stop.covariance *= 2.0;
  }
  Readings& r = difference.readings;
  const Readings &own = recording.readings, &other = simulation.readings;
  r = Readings{};
  for (const auto& [name, values] : own.covariates) r.covariates[name] = {};
  for (std::size_t i = 0; i < own.size(); ++i) {
    const auto landmark = landmark_of.find(recording.landmarks[own.landmark[i]].label);
    if (landmark == landmark_of.end()) continue;
    const int k = stop_of[recording.stops[own.stop[i]].label];
    const auto match = partner.find({k, landmark->second, rank[i]});
    if (match == partner.end()) continue;
    const std::size_t j = match->second;
    const Predicted& at = predicted.at({k, landmark->second});
    const double range = own.range_m[i] - other.range_m[j] + at.f;
    if (!(range > 0.0)) continue;
    r.stop.push_back(own.stop[i]);
    r.landmark.push_back(own.landmark[i]);
    r.repeat.push_back(own.repeat.empty() ? rank[i] : own.repeat[i]);
    if (!own.time_s.empty()) r.time_s.push_back(own.time_s[i]);
    if (!own.row.empty()) r.row.push_back(own.row[i]);
    r.range_m.push_back(range);
    r.bearing_rad.push_back(wrap_angle(own.bearing_rad[i] - other.bearing_rad[j] + at.bearing));
    for (const auto& [name, values] : own.covariates) r.covariates[name].push_back(values[i]);
  }
  if (r.size() < own.size() / 2) return std::nullopt;
  return difference;
}

/// Nats that a further name for the difference of two curves has to earn, p = 3e-4: less may be the first
/// one's formula.
constexpr double curve_price = 6.5;

std::vector<std::string> curve_mismatch(const Rows& rows, const Bookkeeping& known, const SearchResult& found,
                                        const DiagnoseOptions& options) {
  Rows own = rows;
  own.alpha_prior.reset();
  DiagnoseOptions alone = options;
  alone.simulation.reset();
  alone.progress = nullptr;
  if (search(own, known, alone).verdict != Verdict::no_mismatch) return {};
  const std::vector<std::string> curve = {"range_offset", "range_scale", "laser_pointing"};
  std::vector<std::string> best;
  double lowest = found.baseline.nll;
  for (unsigned set = 1; set < 8; ++set) {
    Model model;
    std::vector<std::string> ids;
    for (unsigned j = 0; j < 3; ++j) {
      if (!(set >> j & 1u)) continue;
      const Effect* effect = find_effect(curve[j]);
      if (!effect) continue;
      ids.push_back(curve[j]);
      model.push_back({effect, effect->start_grid(rows.context).front()});
    }
    const Fit fit = refit(rows, model, found.baseline.state, RefitOptions{});
    const double value = fit.nll + curve_price * static_cast<double>(ids.size());
    if (!fit.ok || !(value < lowest)) continue;
    lowest = value;
    best = ids;
  }
  return best;
}

namespace {

/// One channel's noise in the recordings and in the simulation.
struct NoiseLevels {
  const char *channel, *parameter;
  Estimate own, held;

  bool known() const { return own.std_dev && own.value > 0.0 && held.value > 0.0; }
  double log_ratio() const { return std::log(own.value / held.value); }
  double z() const {
    const double sigma = std::hypot(*own.std_dev / own.value, held.std_dev.value_or(0.0) / held.value);
    return std::abs(log_ratio()) / std::max(sigma, 1e-9);
  }
};

std::vector<NoiseLevels> noise_levels(const Calibration& simulation, const Calibration& own) {
  std::vector<NoiseLevels> levels;
  if (own.noise.law == simulation.noise.law && own.noise_estimates.size() == 1 &&
      simulation.noise.parameters.size() == 1) {
    const Estimate held = simulation.noise_estimates.size() == 1
                              ? simulation.noise_estimates[0]
                              : Estimate{simulation.noise.parameters[0], std::nullopt};
    levels.push_back({"range_noise", "sigma_e", own.noise_estimates[0], held});
  }
  if (own.sigma_theta_rad && simulation.sigma_theta_rad)
    levels.push_back({"bearing_noise", "sigma_theta", *own.sigma_theta_rad, *simulation.sigma_theta_rad});
  std::erase_if(levels, [](const NoiseLevels& level) { return !level.known(); });
  return levels;
}

}  // namespace

void compare_noise(const Calibration& simulation, const Calibration& own, Diagnosis& result) {
  constexpr double least_z = 3.5;
  const std::vector<NoiseLevels> levels = noise_levels(simulation, own);
  for (const NoiseLevels& level : levels) {
    if (level.z() < least_z) continue;
    Finding f;
    f.channel = level.channel;
    f.covariate = "constant";
    f.shape = "level";
    f.size = 2.0 * level.log_ratio();
    // Two-sided, times the number of levels compared.
    f.set_log_p(std::min(
        0.0, log_chi_sq_survival(level.z() * level.z(), 1) + std::log(static_cast<double>(levels.size()))));
    f.effects = {"generic"};
    f.everywhere = "it is asked of all readings alike";
    result.location.push_back(f);
    order_location(result.location);
    result.notes.push_back(
        fmt::format("the recordings' {} is {:.3g} times the simulation's: {:.4g} against {:.4g}",
                    level.parameter, level.own.value / level.held.value, level.own.value, level.held.value));
    if (result.verdict != Verdict::no_mismatch) continue;
    result.verdict = Verdict::unexplained;
    result.final_effects = {"generic"};
    Explanation explanation;
    explanation.effects = {"generic"};
    explanation.probability = 1.0;
    explanation.nll = result.after.nll;
    explanation.p_value = f.p_value;
    explanation.physics =
        "The noise of the recordings has another level than the simulation's; set the simulator's spread to "
        "it.";
    result.explanations.push_back(explanation);
  }
}

namespace {

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
  DiagnoseOptions forced = options;
  forced.force = effects;
  forced.held_out = forced.unseen = forced.next_experiments = false;
  forced.progress = nullptr;
  forced.null_draws = 20;
  try {
    const Diagnosis d = diagnose(recordings, forced);
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
  const bool generic = result.verdict == Verdict::unexplained;
  if (generic ? channel == "range" || channel == "bearing"
              : std::any_of(result.final_effects.begin(), result.final_effects.end(), cancels))
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

/// What the readers noted of the simulation: whose it is stands before it.
void add_notes_of_simulation(std::span<const Recording> simulation, Diagnosis& result) {
  for (const Recording& recording : simulation)
    for (const std::string& note : recording.notes) {
      std::string said = "of the simulation: " + note;
      if (std::find(result.notes.begin(), result.notes.end(), said) == result.notes.end())
        result.notes.push_back(std::move(said));
    }
}

}  // namespace
}  // namespace diagnosis

Diagnosis diagnose_against(std::span<const Recording> recordings, std::span<const Recording> simulation,
                           const DiagnoseOptions& options) {
  using namespace diagnosis;
  if (std::optional<Prepared> ready = prepared(recordings)) {
    Diagnosis result = diagnose_against(ready->recordings, simulation, options);
    result.notes.insert(result.notes.end(), ready->notes.begin(), ready->notes.end());
    return result;
  }
  if (const std::optional<Prepared> ready = prepared(simulation))
    return diagnose_against(recordings, ready->recordings, options);
  Diagnosis result = compared(recordings, simulation, options);
  add_notes_of_simulation(simulation, result);
  return result;
}

}  // namespace rangecal
