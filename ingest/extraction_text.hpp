// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal::ingest {

/// What was found and what was thrown away, and why, for the terminal.
std::string describe(const Extraction& extraction, const ExtractOptions& options);

/// The same as JSON (`rangecal-extraction/1`): counts per reason, noise, arc, landmarks.
std::string extraction_json(const Extraction& extraction, const ExtractOptions& options);

/// Notes in the recording (`extraction`) which point of the arc is the range; `source` says in words what it was made of.
void note_extraction(Extraction& extraction, const ExtractOptions& options, const std::string& source);

}  // namespace rangecal::ingest
