// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/calibrate/truth_score.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::app {
struct Advice;
}

namespace rangecal::report {

/// True where the charting library was there when this was built; the full pages need it, the summaries do
/// not.
bool available();
/// Throws InputError with one line that says what to install where it was not.
void require_available();

/// One self-contained HTML file for people: the verdict, the scene, the curve, residuals before and after,
/// noise, the explanation, the table before and after, what stays open, what to record next, how the fit
/// went. Needs no network. `recordings` are those that were diagnosed. Cost: a calibration for the scores of
/// the orders, else linear in the readings; of large recordings every k-th reading is drawn, and the page
/// says so.
std::string diagnosis_page(std::span<const Recording> recordings, const Diagnosis& diagnosis);
/// The same for a calibration: `best` is the one of the report that is shown in full, the others stand in a
/// table. `json`: the file that the result was kept in, if any.
std::string calibration_page(std::span<const Recording> recordings, const CalibrationReport& report,
                             const Calibration& best, const std::string& json = "");
/// The methods side by side: their curves over the readings, the best one's scene, the table with ground
/// truth. `advice` says which to trust.
std::string comparison_page(std::span<const Recording> recordings, const CalibrationReport& report,
                            const std::vector<TruthScore>& scores, const app::Advice& advice);

/// One of many diagnoses; empty or none: there is no such thing.
struct DiagnosisRow {
  std::string recording, verdict;  ///< verdict empty: there is no diagnosis, for this `reason`
  std::string names, estimates, rest, reason;
  std::optional<double> nll_change, heldout_change, heldout_std;    ///< [nats]
  std::optional<double> heldout_rms_before_m, heldout_rms_after_m;  ///< of known distances
  double seconds = 0.0;
};
/// A table with a row each. It has no charts and needs no charting library.
std::string diagnoses_page(const std::vector<DiagnosisRow>& rows);

/// A study from its table of results (docs/study.md): measures over the parameter with the most values, a line per
/// estimator, with standard errors. Throws InputError for a table that is not one of a study.
std::string study_page(const std::string& name, const CsvTable& results);

/// The first part of a page as a fragment of HTML without scripts, styled inline: verdict and main table. For
/// notebooks.
std::string diagnosis_summary(const Diagnosis& diagnosis);
std::string calibration_summary(std::span<const Recording> recordings, const CalibrationReport& report,
                                const Calibration& best);
std::string comparison_summary(std::span<const Recording> recordings, const CalibrationReport& report,
                               const std::vector<TruthScore>& scores);

}  // namespace rangecal::report
