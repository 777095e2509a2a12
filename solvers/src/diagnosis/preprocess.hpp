// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal::diagnosis {

/// Recordings as the search can take them, and what was done to them, in words.
struct Preprocessed {
  std::vector<Recording> recordings;
  std::vector<std::string> notes;
};

/// Leaves out readings whose label was misread, landmarks that no reading sees, covariates that say how uncertain a reading is (`extract` writes them) and those that
/// were computed from the reading (they know its error: within the repeats of a cell they move with it), and states the sigma_xy that recordings ask to be
/// estimated, by `marginal` with labels put right: the search needs a scale for what is too far. None where there
/// is nothing to do.
std::optional<Preprocessed> preprocess(std::span<const Recording> recordings);

}  // namespace rangecal::diagnosis
