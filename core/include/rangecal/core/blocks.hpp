// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// What is held out at a time: readings that share more than what the sensor does, so that a fit to some of them tells of
/// the others.
enum class BlockKind {
  groups,   ///< as the recording states (Groups)
  batches,  ///< of pairs: its settings, five or more
  distances,  ///< of pairs: without batches, distances that five or more readings of three or more share in the mean
  stops,     ///< of landmarks: whole stops, those of one place together
  stretches  ///< 25 stretches of consecutive readings: by time, else by device (landmark) and row
};

/// The block of every reading of a recording, from 0 in the order of first readings.
struct Blocks {
  BlockKind kind = BlockKind::stretches;
  std::vector<int> of;
};

/// By the first kind in the order above that the recording has.
Blocks blocks_of(const Recording& recording);

/// As many blocks of one size would scatter as these do: (sum n)^2 / sum n^2, n the readings of a block.
double effective_blocks(const std::vector<int>& block_of_reading);

/// Those of recordings laid end to end.
struct BlocksOfAll {
  std::vector<int> of;  ///< of every reading, recording after recording
  std::string words;    ///< what they are, each kind once: "batches, distances"
};
BlocksOfAll blocks_of_all(std::span<const Recording> recordings);

/// "batches", "stops", ...; of groups with the columns that state them: "groups of trial".
std::string blocks_in_words(BlockKind kind, const Groups& groups);

}  // namespace rangecal
