// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/refit.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// Parameters of all effects of a fit as the user reads them, in their reported units, each with a standard
/// deviation by the delta method and a 95 % interval: by the profile likelihood where the fit has one
/// (`Fit::limits`), for an amplitude of a cosine and a sine by the law of its length (length_interval.hpp), for
/// its phase by Fieller's (phase_interval.hpp), else Student's t about the estimate, or about the logarithm of a
/// positive scale. What depends on a parameter at one of its bounds has no standard deviation, and limits only
/// where the profile has them; a phase of an amplitude that is not told from 0 has neither. `note` says so.
std::vector<EffectEstimate> effect_estimates(const Rows& rows, const Fit& fit);

}  // namespace rangecal::diagnosis
