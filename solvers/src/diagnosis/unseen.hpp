// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/twins.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// The catalogue at typical size under a model; effects of the model are left out.
std::vector<TypicalEffect> catalogue_of(const Space& space);

/// Those of `effects` that this recording would not show with probability 0.8 (noncentrality below
/// `threshold`), most harmful first, with the size that would show and the harm.
std::vector<Unseen> find_unseen(const Space& space, const std::vector<TypicalEffect>& effects,
                                double threshold);

}  // namespace rangecal::diagnosis
