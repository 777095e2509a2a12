// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/rates.hpp"
#include "diagnosis/twins.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// The effects of the catalogue that the model does not have, at their typical sizes.
std::vector<TypicalEffect> catalogue_of(const Space& space);

/// Those of `effects` whose typical size this recording would show with a probability below 0.8, at the alarm rate of the whole
/// battery; largest range error first, with the size that would show with probability 0.8.
std::vector<Unseen> find_unseen(const Space& space, const std::vector<TypicalEffect>& effects,
                                double alarm_rate, const Rates& rates);

}  // namespace rangecal::diagnosis
