// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// The rows without the cells marked `out`; stops, landmarks and the context stay, so that effects mean the
/// same.
Rows without_cells(const Rows& rows, const std::vector<char>& out);

/// The rows of the recordings marked `kept`, by their index, alone. Of landmarks their stops and landmarks are numbered
/// anew, in `state` too: an effect that names one by its number means another then. What the context says of all
/// readings (distances, durations, columns) stays, so that all other effects mean the same.
Rows of_recordings(const Rows& rows, const std::vector<char>& kept, JointState& state);

/// Recording that a cell belongs to, by its index in the job.
inline int recording_of(const Rows& rows, std::size_t cell) {
  return rows.problem.stops[static_cast<std::size_t>(rows.problem.cells.stop[cell])].recording;
}

/// l_s of the readings under `model` at the given calibration and parameters, stops integrated by Laplace's
/// method [nats]; NaN if the stops have no optimum. `state` gets the stops' optimum.
double laplace_value(const Rows& rows, const Model& model, JointState& state);

/// Fold of every cell, 0 .. folds-1, from the cells' blocks: blocks are ordered by a hash of their index and
/// dealt out in turn. A landmark keeps at least three cells (or all it has) in every training part: -1 marks
/// cells never left out.
std::vector<int> folds_of(const Rows& rows, const std::vector<int>& block_of_cell, int folds);

/// Block of every cell, from 0: those of its rows; blocks that share a cell are one.
std::vector<int> blocks_of_cells(const Rows& rows);

}  // namespace rangecal::diagnosis
