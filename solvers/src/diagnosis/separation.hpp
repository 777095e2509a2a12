// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// Noncentrality left between two explanations: what `causes` do to the readings at their fitted sizes, after
/// the calibration and every direction of `rivals`, and of what both explanations `share`, were projected
/// out. Between explanations that change the spread of the stops alone: twice the divergence of the two, as fitted. Small:
/// this design cannot tell them apart, whatever the noise. Negative if neither is so.
double separation(const Rows& rows, const JointState& state, const Model& causes, const Model& rivals,
                  const Model& share);

}  // namespace rangecal::diagnosis
