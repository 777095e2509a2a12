// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"

namespace rangecal::app {

/// One line of the summary: "Outcome", "converged by marginal: this is the optimum".
struct SummaryItem {
  std::string title, text;
};
/// What the summary page says, in its order, without its table of the curve.
std::vector<SummaryItem> summary_items(const CalibrationReport& report, const Calibration& calibration,
                                       std::span<const Recording> recordings, const std::string& json);

/// The page a person reads first: what f is, the correction and the noise over the range, bearings, counts,
/// outcome, what is least certain, what to do next. `json` names the file written, or is empty.
std::string summary_page(const CalibrationReport& report, const Calibration& calibration,
                         std::span<const Recording> recordings, const std::string& json);

/// What to record where there is too little for any answer.
std::string too_few_advice(RecordingKind kind);

/// RMS over the stops of (estimated - commanded position) / sigma_xy, per axis; independent stops of a given sigma_xy only.
std::optional<double> stop_strain(const Calibration& calibration, std::span<const Recording> recordings);

/// What `--from` found: how f moved, in millimetres over the range, and whether that is more than chance.
std::string change_page(const Calibration& before, const Calibration& after);

/// The Cramer-Rao bound of alpha, one sentence for the estimate and one for the truth where the recordings have it.
std::vector<std::string> bound_in_words(const Calibration& calibration,
                                        std::span<const Recording> recordings);

/// The numbers behind: noise, landmarks, stops, the bound, the batches of pairs, likelihoods, iterations, weakest
/// direction.
std::string numerics_page(const CalibrationReport& report, const Calibration& calibration,
                          std::span<const Recording> recordings);

}  // namespace rangecal::app
