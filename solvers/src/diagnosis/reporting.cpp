// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/reporting.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <optional>
#include <string_view>
#include <utility>

#include "diagnosis/held_out.hpp"
#include "diagnosis/identifiability.hpp"
#include "diagnosis/laws/law_search.hpp"
#include "diagnosis/location.hpp"
#include "diagnosis/places.hpp"
#include "diagnosis/report.hpp"
#include "diagnosis/residual_bins.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "diagnosis/simulation_compare.hpp"
#include "diagnosis/undetermined.hpp"
#include "diagnosis/withdrawal.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"

namespace rangecal::diagnosis {
namespace {

/// What the recordings leave open of the curve of the model that is stood by: of the seed model, and where a name
/// completes it of that too, whose noise may be far smaller. A simulation's curve is given.
std::optional<Undetermined> still_undetermined(const Rows& rows, std::span<const Recording> recordings,
                                               const SearchResult& found) {
  if (rows.alpha_prior) return std::nullopt;
  std::optional<Undetermined> open = undetermined(rows, recordings, found.baseline);
  if (open && found.named()) open = undetermined(rows, recordings, found.best.fit);
  return open;
}

/// The layout of the recordings and the model they are simulated by again.
void add_simulation_model(const Rows& rows, std::span<const Recording> recordings,
                          std::span<const Recording> corrected, const SearchResult& found, const Fit* generic,
                          Diagnosis& result) {
  SimulationModel& model = result.simulation;
  model.recordings.assign(recordings.begin(), recordings.end());
  for (const Recording& recording : corrected) model.landmark_read.push_back(recording.readings.landmark);
  model.calibration = result.corrected;
  const bool named = found.named();
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

/// The report of one search, written again where a name is withdrawn.
class Reporting {
 public:
  Reporting(const Rows& rows, std::span<const Recording> recordings, SearchResult& found,
            const DiagnoseOptions& options)
      : rows_(rows), recordings_(recordings), found_(found), options_(options) {}

  Diagnosis run(std::span<const Recording> corrected) {
    settle_what_is_open();
    write();
    const std::string against = options_.force ? std::string() : withdraw_names(rows_, found_, result_);
    if (!against.empty()) {
      settle_what_is_open();  // of the model that is delivered now
      write();
    }
    if (options_.laws && found_.verdict != Verdict::no_mismatch && !unobservable()) {
      say("looking for laws", 0.7);
      LawSearchResult laws = find_laws(rows_, found_, generic_ && generic_->effect ? &*generic_ : nullptr,
                                       options_, RefitOptions{});
      result_.laws = std::move(laws.laws);
      if (laws.over_names > 0.0)
        result_.notes.push_back(fmt::format(
            "{} without any of these names is likelier than they are, by {:.1f} nats: they may be what the "
            "catalogue makes of a law that it does not hold",
            result_.laws.front().id, laws.over_names));
    }
    add_residual_bins(rows_, found_, completed_, result_);
    place_by_residuals(rows_, result_.location);
    say("looking for what could be hidden", 0.9);
    DiagnoseOptions identifiability = options_;
    if (unobservable())
      identifiability.unseen = identifiability.next_experiments = false;  // of a curve that is none
    add_identifiability(rows_, found_, identifiability, result_);
    add_simulation_model(rows_, recordings_, corrected, found_, curve(), result_);
    write_sentence(against);
    if (curve()) take_noise_of(*curve());
    return std::move(result_);
  }

 private:
  bool unobservable() const { return result_.verdict == Verdict::unobservable; }
  const Fit* curve() const { return generic_ ? &generic_->fit : nullptr; }
  void say(const char* stage, double fraction) const {
    if (options_.progress) options_.progress(stage, fraction);
  }

  /// Where landmarks and curve can shift together a score's first order is none: no name is safe.
  void settle_what_is_open() {
    open_ = still_undetermined(rows_, recordings_, found_);
    differs_ = found_.verdict != Verdict::no_mismatch;
    if (!open_ || rows_.pairs || options_.force) return;
    found_.verdict = Verdict::no_mismatch;
    found_.rivals.clear();
  }

  void mark_calibrations() {
    if (!open_) return;
    mark_undetermined(rows_, *open_, found_.baseline, result_.baseline);
    mark_undetermined(rows_, *open_, found_.baseline, result_.corrected);
  }

  void write() {
    result_ = assemble_report(rows_, recordings_, found_);
    mark_calibrations();
    if (open_ && result_.verdict == Verdict::no_mismatch) result_.verdict = Verdict::unobservable;
    if (unobservable() && differs_)
      result_.notes.push_back(
          "the residuals differ from those of the seed model, but no cause is named beside a curve that is open");
    for (Explanation& e : result_.explanations)
      e.probability = std::min(e.probability, 1.0);  // of the effects asked for alone
    for (std::string& warning : plausibility_warnings(recordings_, result_.corrected))
      result_.notes.push_back(std::move(warning));
    generic_ = add_generic(rows_, found_, result_);
    add_location(rows_, found_, generic_ ? &*generic_ : nullptr, result_);
    // Where no curve stands for what a partial name leaves, the name's own.
    completed_ = !curve() && found_.partly() ? &found_.best.fit : curve();
    if (options_.simulation) compare_noise(*options_.simulation, result_.corrected, result_);
    if (!options_.held_out || unobservable()) return;
    say("predicting readings held out", 0.8);
    add_held_out(rows_, found_, completed_, result_);
  }

  void write_sentence(const std::string& against) {
    result_.sentence = verdict_sentence(result_);
    if (open_ && !unobservable())
      result_.sentence += fmt::format(" The calibration itself is not determined: {}.", open_->what);
    if (!against.empty() && !unobservable()) result_.sentence += " " + against;
    constexpr std::string_view found_by_search = "Explained by ";
    if (options_.force && result_.sentence.starts_with(found_by_search))
      result_.sentence = fmt::format("Fitted as asked: {} The seed model's residuals have p = {:.2g}.",
                                     result_.sentence.substr(found_by_search.size()), result_.alarm_p_value);
    if (options_.simulation && result_.verdict == Verdict::no_mismatch)
      result_.sentence = "No mismatch: the simulation accounts for this recording within its noise.";
  }

  /// No name to correct by, but the noise is that of the completed model. Beside a curve that moves the ranges, which no correction knows,
  /// the curve would be off by what that one takes up: the calibration stays, its noise with what is left in it.
  void take_noise_of(const Fit& curve) {
    if (std::any_of(curve.model.begin(), curve.model.end(), [](const ActiveEffect& a) {
          return is_generic(*a.effect) && a.effect->info().kind == EffectKind::mean &&
                 a.effect->info().channel == "range";
        }))
      return;
    Calibration of_curve = calibration_of(rows_, recordings_, curve);
    Calibration& corrected = result_.corrected;
    corrected.alpha = std::move(of_curve.alpha);
    corrected.alpha_covariance = std::move(of_curve.alpha_covariance);
    corrected.effects_covariance.reset();  // of the curve without the one that stands for what is left
    corrected.noise = std::move(of_curve.noise);
    corrected.noise_estimates = std::move(of_curve.noise_estimates);
    corrected.sigma_theta_rad = of_curve.sigma_theta_rad;
    mark_calibrations();
  }

  const Rows& rows_;
  std::span<const Recording> recordings_;
  SearchResult& found_;
  const DiagnoseOptions& options_;
  std::optional<Undetermined> open_;
  bool differs_ = false;  ///< the search saw a mismatch, whatever is said of it
  Diagnosis result_;
  std::optional<GenericModel> generic_;
  const Fit* completed_ = nullptr;  ///< what is shown as the completed model
};

}  // namespace

Diagnosis diagnosis_of(const Rows& rows, std::span<const Recording> recordings,
                       std::span<const Recording> corrected, SearchResult& found,
                       const DiagnoseOptions& options) {
  return Reporting(rows, recordings, found, options).run(corrected);
}

}  // namespace rangecal::diagnosis
