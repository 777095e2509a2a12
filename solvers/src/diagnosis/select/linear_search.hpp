// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "diagnosis/select/dictionary.hpp"
#include "diagnosis/select/evidence.hpp"

namespace rangecal::diagnosis {

/// A set of effects on the linearised problem.
struct LinearSet {
  std::vector<int> blocks;  ///< of the dictionary, one a member, by their names
  double gain = 0.0;        ///< over the seed model [nats]
  double log_posterior = 0.0;
  Model model;  ///< the effects at their estimates, within their bounds
};

/// Sets of effects of high posterior probability on the linearised problem, the likeliest first. Climbs by names from the empty set, and from
/// `start` without its curves; then changes the likeliest set that was not yet looked at by one member more, one less or another one (two more,
/// of the first two; two names in place of a curve, of the first four), until none within 6 nats of the best is left, 40 sets at most. Every
/// effect stands at the start of its grid that fits best beside the others.
std::vector<LinearSet> search_linear(const Rows& rows, Dictionary& dictionary, const Model& start,
                                     const MemberCounts& counts, const SelectionPriors& priors);

}  // namespace rangecal::diagnosis
