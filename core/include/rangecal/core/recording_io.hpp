// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// Reads a recording folder (FORMAT: recording.yaml, observations.csv, stops.csv, ... or pairs.csv), validates it,
/// drops and counts unusable readings. Throws InputError with file, row and column for anything malformed.
/// Cost: linear in the number of rows.
Recording load_recording(const std::string& folder);

/// Writes the recording into `folder` (created if missing) so that load_recording gives it back: numbers with 17
/// significant digits, each file through a temporary and a rename, so that none is left half-written.
void save_recording(const Recording& recording, const std::string& folder);

}  // namespace rangecal
