// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// Slopes of the rows in the parameters that are fitted: of the mean range [m], and of ln s by effects and by the calibration
/// [rows x parameters].
struct MovedReadings {
  SerialErrors::Columns means, spreads, levels;
};

/// Beside tails: slopes of ln p of every row's error given the rows before it (WanderingPart) in the parameters that move the
/// readings, the last of which are `parameters`: of tails in their logarithms, of the sequence in their logits [rows x parameters].
/// The densities are differentiated by differences, the recursion along the sequence as it stands, in one pass over the rows.
SerialErrors::Columns prediction_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                        const CellGeometry& geometry, const MovedReadings& moved,
                                        const std::vector<FreeParameter>& parameters);

/// Beside tails: -sum ln p of every row's error given the rows before it, in metres [nats], with the errors of the working problem.
double nll_along_sequence(const Rows& rows, const Model& model, const WorkingProblem& working,
                          const CellGeometry& geometry);

}  // namespace rangecal::diagnosis
