// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// FORMAT: `indistinguishable_from` holds at most three sets. Two causes with a twin each make three.
inline constexpr std::size_t most_rivals = 3;

/// True if another explanation that is `gap` nats less likely than the best is listed beside it: less than `naming_gap_nats`, and less than
/// half a nat where the design separates the two. `seed`: the state of the seed model.
bool is_listed(const Rows& rows, const DiagnoseOptions& options, const JointState& seed, const Model& best,
               const Model& other, double gap);

/// Other explanations of the same size that the data do not reject, at most three, in the order of `ranked`: those that are
/// `is_listed`.
void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result);

}  // namespace rangecal::diagnosis
