// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "diagnosis/search.hpp"
#include "diagnosis/select/evidence.hpp"
#include "diagnosis/select/hypothesis.hpp"

namespace rangecal::diagnosis {

/// All sets that were fitted, the likeliest first; the first of them all is the root, the seed model with what
/// bookkeeping found.
using Hypotheses = std::vector<std::unique_ptr<Hypothesis>>;

/// Searches for the set of members of highest posterior probability beside the root, starting from none:
///
///   add       what the scores of a set's residuals propose, best first
///   drop      one member
///   exchange  one member, for what the residuals without it propose
///
/// until none of these gains. A set is fitted once, by `refit`, which moves all of its parameters and the calibration.
Hypotheses search_sets(const Rows& rows, const Fit& root, const Bookkeeping& known, const Rates& rates,
                       const RefitOptions& options, const SelectionPriors& priors);

/// The search for any number of causes: the same result as `search`.
SearchResult search_by_sets(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options);

}  // namespace rangecal::diagnosis
