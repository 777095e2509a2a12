// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <limits>
#include <vector>

#include "rangecal/solvers/diagnosis/simulation_model.hpp"

namespace rangecal::diagnosis {

/// True distances [m] at which a landmark is seen at all.
struct VisibleRange {
  double min_m = 0.0, max_m = std::numeric_limits<double>::infinity();
};

/// What simulate() draws, with every reading of the layout still in it: such as are negative or infinite too. Readings beyond
/// `visible` are drawn, but what an effect refers to (a middle of the ranges, say) does not count them.
std::vector<Recording> drawn_recordings(const SimulationModel& model, std::uint64_t seed,
                                        const VisibleRange& visible = {});

}  // namespace rangecal::diagnosis
