// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/candidates.hpp"

namespace rangecal::diagnosis {

/// Errors that add up from stop to stop (a variance) and another effect (one displacement, one angle)
/// may fit a recording alike, and the prices of the two are of different kinds. Where the best of
/// either kind lie within 8 nats (pairs, an error that a batch shares against a curve: 20), what they predict of
/// stops (batches) left out decides too: the evidence of all
/// effects on the stops' spread grows by
///   l_other - l_spread,
/// l the negative log density of the stops left out, five folds.
void settle_by_stops_left_out(const Rows& rows, const RefitOptions& options,
                              std::vector<Candidate>& candidates);

}  // namespace rangecal::diagnosis
