// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/select/set_search.hpp"

namespace rangecal::diagnosis {

/// Sets the verdict of `result` from the sets that were fitted, the likeliest first. `root`: the seed model with what
/// bookkeeping found.
///
///   names     of the likeliest set, each of probability 0.5 or more over all sets (its class's: exact twins, and what is
///             listed as standing in its place), none that a curve without a name is confounded with, and
///             no formula that a curve along its own covariate improves by much; the one that
///             costs most in a corrected range first
///   rest      what its curves without a name carry, and what its residuals hold at a corrected p below the rate at which
///             residuals count as clean; material where its RMS size over the readings exceeds the tolerance
///   verdict   explained: names, no material rest; partly_explained: names, and one; unexplained: no name
void decide(const Rows& rows, const Fit& root, Hypotheses table, const DiagnoseOptions& options,
            const RefitOptions& refit_options, const SelectionPriors& priors, SearchResult& result);

}  // namespace rangecal::diagnosis
