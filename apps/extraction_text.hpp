// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal::app {

/// What was found and what was thrown away, and why, for the terminal.
std::string describe(const Extraction& extraction, const ExtractOptions& options);

/// The same as JSON (`rangecal-extraction/1`): counts per reason, noise, arc, landmarks.
std::string extraction_json(const Extraction& extraction, const ExtractOptions& options);

/// Writes the recording with its note: `extraction` in recording.yaml says which point of the arc is the range;
/// extraction.json holds the counts. `source` says in words what it was made of.
void save_extraction(const Extraction& extraction, const ExtractOptions& options, const std::string& folder,
                     const std::string& source);

}  // namespace rangecal::app
