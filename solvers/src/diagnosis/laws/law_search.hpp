// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/generic.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Laws for a mismatch without a name: sums of terms (pieces.hpp) that change the channel of the smooth curve that stands for it.
///
/// A law's evidence over the model without it is that of a set of causes (select/evidence.hpp):
///
///   E = gain + ln(volume of its parameters) - sum over its terms of ln T      [nats]
///
/// T the terms that one can be chosen from: ln T nats is what it takes to say which. Terms are added, the best three laws kept at a
/// time, for as long as E grows. The curve's evidence is the same with its knots' prior, and ln V for its covariate, one of the V that
/// laws are made of.
std::vector<Law> find_laws(const Rows& rows, const SearchResult& found, const GenericModel& curve,
                           const RefitOptions& options);

}  // namespace rangecal::diagnosis
