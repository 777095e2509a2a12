// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// Noncentrality left between two explanations: what `causes` do to the readings at their fitted sizes, after
/// the calibration and every direction of `rivals`, and of what both explanations `share`, were projected
/// out. Where both change the spread of the stops alone: twice the divergence of the causes' law from that of the rivals,
/// as fitted. Small: this design cannot tell them apart. Negative if one of the two changes neither the means nor that spread
/// alone.
double separation(const Rows& rows, const JointState& state, const Model& causes, const Model& rivals,
                  const Model& share);

}  // namespace rangecal::diagnosis
