// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "diagnosis/search.hpp"
#include "diagnosis/select/evidence.hpp"
#include "diagnosis/select/hypothesis.hpp"

namespace rangecal::diagnosis {

/// All sets that were fitted, among them the root: the seed model with what bookkeeping found. The likeliest stands first once the search is
/// over; while it runs, the root does.
using Hypotheses = std::vector<std::unique_ptr<Hypothesis>>;

/// Searches for the set of members of highest posterior probability beside the root, the seed model with what bookkeeping
/// found. From the root on: the problem is linearised at the likeliest set so far (Dictionary) and searched there by adding,
/// dropping and exchanging members (search_linear); the likeliest sets are fitted exactly by `refit`, which moves all of their
/// parameters and the calibration, as are this set with each name for a spread, tail or dependence that its residuals propose,
/// and without each of its members; until none of them is likelier. Where another law of the noise is due beside what was found,
/// the search is made again under it, from the root and from what was found.
SearchResult search_by_sets(const Rows& rows, const Bookkeeping& known, const DiagnoseOptions& options);

}  // namespace rangecal::diagnosis
