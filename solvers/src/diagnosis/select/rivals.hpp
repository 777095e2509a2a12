// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Other explanations of the same size that the data do not reject, at most two, in the order of `ranked`: those whose evidence is
/// within `naming_gap_nats` of the best's, and half a nat where the design separates the two.
void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result);

}  // namespace rangecal::diagnosis
