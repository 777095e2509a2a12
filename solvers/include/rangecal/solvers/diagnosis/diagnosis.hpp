// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"

namespace rangecal {

/// `partly_explained`: names, and something material beside them that has none. `unobservable`: the recording does not determine
/// the curve, so that nothing is fine and no cause is named.
enum class Verdict { no_mismatch, explained, partly_explained, unexplained, unobservable };
/// The value's own name: "no_mismatch", ...
const char* to_string(Verdict verdict);

/// Binned residual against the located covariate, before and after the model was completed.
struct BinnedResidual {
  double at = 0.0;                   ///< centre of the bin, in the covariate's unit
  double before = 0.0, after = 0.0;  ///< mean residual [m] or [rad], or log variance ratio
  double std_dev = 0.0;              ///< of the mean
  int readings = 0;
};

/// One place where the seed model and the recording differ.
struct Finding {
  std::string channel, covariate, shape;  ///< as docs/formats.md names them
  /// Ids of the effects of the final model that it belongs to: several where their curves are one along one
  /// covariate; "generic" where none has a name.
  std::vector<std::string> effects;
  std::optional<double> from, to;  ///< interval of the covariate in which it acts
  std::string group;               ///< labels of the landmarks, or the stop, where it is a group
  std::string everywhere;          ///< why there is no place; empty where there is one
  double size = 0.0;               ///< [m], [rad], or change of log variance
  std::string unit;
  /// By the likelihood ratio, corrected for everything that was looked at; least_p_value stands for that or less.
  double p_value = 1.0;
  double log_p = 0.0;  ///< natural logarithm of the same, which does not underflow
  /// Part of the excess chi-square of the cell means that it takes away; none where the excess is within noise, or
  /// where it is no change of a mean.
  std::optional<double> share;
  std::vector<BinnedResidual> residuals;

  static constexpr double least_p_value = 1e-300;
  /// Sets `log_p` and `p_value`.
  void set_log_p(double value);
};

struct EffectEstimate {
  std::string name;  ///< "range_eccentricity.amplitude_m"
  /// NaN beside the estimate where it was chosen from a list, or read off the values, and where `note` says why
  double estimate = 0.0, std_dev = 0.0, low95 = 0.0, high95 = 0.0;
  std::string note;  ///< "at its bound"; "any: ..." of a phase whose amplitude is not told from 0; else empty
};

struct Explanation {
  std::vector<std::string> effects;
  double probability = 0.0;
  std::vector<EffectEstimate> parameters;
  double nll = 0.0;
  std::optional<double> heldout_nll, heldout_std;  ///< std: of the difference to the baseline
  double p_value = 1.0;
  std::vector<std::vector<std::string>> indistinguishable_from;  ///< at most three sets
  std::string separated_by, physics;
};

struct Unseen {
  std::string effect;
  std::map<std::string, double> typical;
  std::optional<double> detectable;  ///< in the unit of the first typical parameter; none if none would show
  double harm_m = 0.0;               ///< RMS error in corrected range at the typical size
  std::string settled_by;
};

struct NextExperiment {
  std::string code, change;
  std::vector<std::string> settles;
  double power = 0.0;
};

/// What speaks for one name of the final model.
struct Member {
  std::string effect;
  double probability = 0.0;  ///< over the sets compared, of the class of effects that it cannot be told from
  /// Log evidence of the final model without it, less that with it [nats]; none where that was not fitted.
  std::optional<double> log_evidence_without;
  std::optional<double>
      heldout_nll_without;  ///< of the final model without it; none where nothing was held out
};

/// A formula for a mismatch that has no name.
struct Law {
  std::string id, channel;             ///< "law_1"; of docs/formats.md
  std::string formula;                 ///< docs/effects-by-formula.md
  std::vector<std::string> variables;  ///< that it depends on
  std::vector<EffectEstimate> parameters;
  double log_evidence = 0.0;  ///< over the model without it [nats]
  double log_evidence_over_curve =
      0.0;  ///< over the smooth curve without a name [nats]; below 0: the curve is likelier
  bool agrees_with_first = false;  ///< wherever these recordings have readings, to a twentieth of the squares
  std::string text;                ///< as a file for `--effects` and `predict`, with what was estimated
};

/// Goodness of fit, for the table before / after.
struct FitSummary {
  double nll = 0.0;
  std::optional<double> heldout_nll, heldout_std;  ///< std: of the difference to the baseline
  /// Of the means of repeats at known distances, each predicted from the blocks left in; none for landmarks.
  std::optional<double> heldout_rms_range_m;
  double rms_range_m = 0.0, rms_bearing_rad = 0.0;  ///< of the cell means
  double chi_sq_per_dof = 0.0;                      ///< of the cell means, dependence and noise as modelled
};

struct Diagnosis {
  Verdict verdict = Verdict::no_mismatch;
  std::string sentence;             ///< the verdict in one sentence a person can act on
  Calibration baseline, corrected;  ///< `corrected` carries the effects
  FitSummary before, after;
  double alarm_p_value = 1.0;  ///< smallest corrected p-value of the whole battery
  std::vector<Finding> location;
  std::vector<Explanation> explanations;
  std::vector<std::string>
      final_effects;  ///< empty for no_mismatch and unobservable, {"generic"} for unexplained, at last for partly_explained
  std::vector<Member> members;  ///< the names of `final_effects` that were searched for
  /// Probability of the sets that were seen but not fitted, by the problem linearised at those that were; none where nothing was
  /// looked for.
  std::optional<double> evidence_omitted;
  /// Where the likeliest set holds a curve without a name: the likeliest set of names alone, if its odds are no worse than one to twenty.
  std::vector<std::string> nearly_as_likely;
  std::vector<std::vector<std::string>> twins;
  std::vector<Unseen> unseen;
  std::vector<NextExperiment> next_experiments;
  std::vector<std::string>
      notes;  ///< what could not be modelled and which column or repetition it would take
  /// What was left out at a time: "recordings", where several were given and each can be predicted from the others, else
  /// "groups of COLUMN", "batches", "distances", "stops" or "stretches" of consecutive readings (core/blocks.hpp);
  /// empty where nothing was.
  std::string heldout_blocks;
  double heldout_effective_blocks =
      0.0;                     ///< as many of one size: (sum n)^2 / sum n^2, n the readings of a block
  std::vector<Law> laws;       ///< where they were asked for and something has no name: the likeliest first
  SimulationModel simulation;  ///< the final model with the recordings' layout: `simulate --from`
};

/// One set of causes that the search fitted.
struct TriedSet {
  std::vector<std::string> members;  ///< ids of effects; "curve of C along X" for a curve without a name
  std::vector<std::string> parent;   ///< the set from which it was reached
  double predicted_gain =
      0.0;            ///< gain [nats] by the linearised problem, or by a score; 0 where neither predicted any
  double gain = 0.0;  ///< NLL of the seed model, with what bookkeeping found, less that of the set [nats]
  double parameter_volume = 0.0;   ///< what choosing its parameters costs [nats]
  double formula_allowance = 0.0;  ///< what is gained when formulas may be a little off in shape [nats]
  double prior_mass = 0.0;         ///< ln of the prior probability of the set over that of none [nats]
  double log_posterior = 0.0;      ///< the sum of the four above
  double probability = 0.0;        ///< over all sets that were fitted
  bool scanned = false;            ///< likelier sets were looked for from there
  struct Proposal {
    std::vector<std::string> members;
    double predicted_gain = 0.0;  ///< gain [nats] on the problem linearised at this set
    double log_posterior = 0.0;   ///< the same of the posterior
    bool fitted = false;
  };
  std::vector<Proposal> proposals;  ///< likely sets of the linearised problem, the likeliest first
};

struct DiagnoseOptions {
  double alarm_rate = 0.02;      ///< of the whole battery on a recording of the seed model
  double naming_gap_nats = 3.0;  ///< a rival within this many nats is a twin, not a loser
  int null_draws = 600;          ///< simulations of the battery under the fitted model
  bool held_out = true, unseen = true, next_experiments = true;
  bool laws = false;                      ///< look for formulas of what has no name
  std::optional<CurveFamily> curve;       ///< of pairs, as in CalibrateOptions; nullopt takes no spline
  std::optional<Calibration> simulation;  ///< alpha and noise are held at this calibration;
                                          ///< one with effects is simulated, as diagnose_against
  std::optional<std::vector<std::string>> force;  ///< fit exactly these effects, whatever the battery says
  /// Effects that are left out of the catalogue, along columns too. Exchanged labels, grids and missing readings are found before the
  /// search and cannot be.
  std::vector<std::string> without;
  std::function<void(const TriedSet&)> trace;  ///< every set of causes that was fitted, the likeliest first
  std::function<void(const std::string& stage, double fraction)> progress;

  /// Throws InputError for what can be asked of no recording: a rate outside of (0, 1), no draws, a negative gap, an effect that is not known, or
  /// cannot be left out.
  void check() const;
};

/// Locates the mismatch between the seed model and the recordings, names the physics left out, models it and shows
/// the fit improve on data held out. Where `calibrate` would call the curve unobservable, so are the calibrations here.
/// Deterministic. Throws InputError for recordings that no calibration can use.
/// Cost: linear in the readings times the number of catalogued signatures.
Diagnosis diagnose(std::span<const Recording> recordings, const DiagnoseOptions& options = {});

/// The same against a simulation of the recordings, made by any simulator with the same stops and landmark labels.
///
/// Where the simulation follows the seed model, its curve is held against the recordings with its own sampling error:
/// alpha ~ N(alpha_sim, cov_sim). Else, where the layouts match, cell by cell: the simulation's departures from its own
/// fit are taken from the recordings' readings, and their sampling error is added, so that what both share cancels.
/// What does not cancel (noise, a wobble whose phase moves with the stops) is no mismatch where one model accounts for both.
/// Landmarks and stops are free. A finding must also stand in the paired comparison. Throws InputError for a
/// simulation of another kind or with other labels.
Diagnosis diagnose_against(std::span<const Recording> recordings, std::span<const Recording> simulation,
                           const DiagnoseOptions& options = {});

/// The verdict in one sentence a person can act on.
std::string verdict_sentence(const Diagnosis& diagnosis);

/// `rangecal-diagnosis/1` JSON (docs/formats.md). Numbers that are not finite are null.
std::string diagnosis_to_json(const Diagnosis& diagnosis);

/// `rangecal-trace/1` JSON of the sets that a search fitted (docs/formats.md).
std::string trace_to_json(const std::vector<TriedSet>& sets);

}  // namespace rangecal
