// SPDX-License-Identifier: BSD-3-Clause
#pragma once

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

/// What `--from` found: how f moved, in millimetres over the range, and whether that is more than chance.
std::string change_page(const Calibration& before, const Calibration& after);

/// The numbers behind: landmarks, stops, likelihoods, iterations, weakest direction.
std::string numerics_page(const CalibrationReport& report, const Calibration& calibration,
                          std::span<const Recording> recordings);

}  // namespace rangecal::app
