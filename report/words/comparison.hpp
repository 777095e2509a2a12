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

/// Which method to trust, in the parts of one sentence.
struct Advice {
  std::string trust;  ///< "Trust marginal: it has the exact likelihood ...", without a full stop
  std::vector<std::string> others;  ///< what each other method gives away
  std::string against;  ///< "BUT ...": what speaks against the one trusted; empty where nothing does
};
Advice advise(const CalibrationReport& report, std::span<const Recording> recordings,
              const std::vector<TruthScore>& scores);
/// All of it as one sentence.
std::string advice_text(const Advice& advice);

/// The sentences under the table: what a mark in it means, and where true distances came from.
std::vector<std::string> footnotes(const CalibrationReport& report, const std::vector<TruthScore>& scores);
/// The same as text, with the report's notes.
std::string footnotes_text(const CalibrationReport& report, const std::vector<TruthScore>& scores);

}  // namespace rangecal::app
