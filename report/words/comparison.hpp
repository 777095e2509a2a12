// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/calibrate/truth_score.hpp"

namespace rangecal::app {

/// One column per method behind the row's name: estimates with standard deviations, likelihoods, time, errors against
/// ground truth. The first row names the methods; rows that no method fills are left out.
std::vector<std::vector<std::string>> comparison_rows(const CalibrationReport& report,
                                                      const std::vector<TruthScore>& scores);
/// The same as text.
std::string comparison_table(const CalibrationReport& report, const std::vector<TruthScore>& scores);

/// One sentence: which method to trust, why, what each other gives away, and what speaks against it.
std::string verdict(const CalibrationReport& report, std::span<const Recording> recordings,
                    const std::vector<TruthScore>& scores);

/// The sentences under the table: what a mark in it means, and where true distances came from.
std::vector<std::string> footnotes(const CalibrationReport& report, const std::vector<TruthScore>& scores);
/// The same as text, with the report's notes.
std::string footnotes_text(const CalibrationReport& report, const std::vector<TruthScore>& scores);

}  // namespace rangecal::app
