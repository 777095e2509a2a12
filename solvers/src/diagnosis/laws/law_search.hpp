// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/generic.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Laws, the likeliest first.
struct LawSearchResult {
  std::vector<Law> laws;
  /// Nats by which the first, without any name, is likelier than the names of the answer with the likeliest law beside them; 0 where it
  /// stands beside them, or there are none.
  double over_names = 0.0;
};

/// Laws for a mismatch: sums of terms (pieces.hpp) on the channel of the smooth curve that stands for what has no name, or,
/// where there is none, on those of the findings.
///
/// A law's evidence over the model without it is that of a set of causes (select/evidence.hpp):
///
///   E = gain + ln(volume of its parameters) - sum over its terms of ln T      [nats]
///
/// with T the number of terms to choose from: saying which one takes ln T nats. Terms are added as long as E grows, keeping the
/// best three laws at a time. The curve's evidence is computed in the same way, with its knots' prior, and ln V for the choice of
/// its covariate among the V that laws are made of.
///
/// Names may be what the catalogue makes of a law that it does not hold. Where some were given, laws are also looked for without them,
/// and compared with the names, a name being a term out of as many as there are names. Those that are likelier than the names and the
/// best law beside them, by the gap at which a rival is no twin, are the answer then; else the laws beside the names are.
LawSearchResult find_laws(const Rows& rows, const SearchResult& found, const GenericModel* curve,
                          const DiagnoseOptions& options, const RefitOptions& refit_options);

}  // namespace rangecal::diagnosis
