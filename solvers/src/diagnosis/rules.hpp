// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "diagnosis/search.hpp"

/// Rules that keep names honest, shared by whole and partial names.
namespace rangecal::diagnosis {

inline constexpr double clean_rate = 0.005;  ///< corrected p below which a model's residuals are not clean
/// Share of the nats that a first name gained: a second that adds less may be its formula's error.
inline constexpr double trace_share = 0.1;

/// Nats of the best free curve in the means of a channel, less what choosing it cost.
double best_curve(const Battery& battery, const Rates& rates, const std::string& channel);

/// True if a single name explains as much as the best free curve (nats). Scores of the mean are compared with
/// scores, but for a jump: its score counts those on the wrong side that the seed model has there.
bool equals_curve(const Candidate& name, double curve);

/// Other explanations of the same size that the data do not reject, best first, at most two.
void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result);

}  // namespace rangecal::diagnosis
