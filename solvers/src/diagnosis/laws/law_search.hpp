// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/generic.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Laws for a mismatch without a name: sums of terms (pieces.hpp) on the channel of the smooth curve that describes it.
///
/// A law's evidence over the model without it is that of a set of causes (select/evidence.hpp):
///
///   E = gain + ln(volume of its parameters) - sum over its terms of ln T      [nats]
///
/// with T the number of terms to choose from: saying which one takes ln T nats. Terms are added as long as E grows, keeping the
/// best three laws at a time. The curve's evidence is computed in the same way, with its knots' prior, and ln V for the choice of
/// its covariate among the V that laws are made of.
std::vector<Law> find_laws(const Rows& rows, const SearchResult& found, const GenericModel& curve,
                           const RefitOptions& options);

}  // namespace rangecal::diagnosis
