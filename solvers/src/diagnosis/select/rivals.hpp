// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// FORMAT: `indistinguishable_from` holds at most three sets. Two causes with a twin each make three.
inline constexpr std::size_t most_rivals = 3;

/// Nats by which another explanation may be less likely than the best and still be listed beside it: `naming_gap_nats`, and half a nat
/// where the design separates the two. `seed`: the state of the seed model.
double tolerated_gap(const Rows& rows, const DiagnoseOptions& options, const JointState& seed,
                     const Model& best, const Model& other);

/// Other explanations of the same size that the data do not reject, at most three, in the order of `ranked`: those whose evidence is
/// within `tolerated_gap` of the best's.
void add_rivals(const Rows& rows, const DiagnoseOptions& options, const std::vector<Candidate>& ranked,
                SearchResult& result);

}  // namespace rangecal::diagnosis
