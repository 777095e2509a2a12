// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

#include "extraction_text.hpp"

namespace rangecal::ingest {

/// What was made of files of scans, and by which options.
struct Extracted {
  Extraction extraction;  ///< its recording carries the note of the extraction
  ExtractOptions options;
  std::string source, format;         ///< of the scans, in words
  std::vector<std::string> warnings;  ///< what was left out of files that were cut off; a warning about units
};

/// Says how far the reading of a file is, 0 to 1.
using ReadProgress = std::function<void(const std::string& file, double share)>;

/// Declares the options of `rangecal extract` that say what is made; what is returned makes it once they are parsed.
/// `progress` may be empty.
std::function<Extracted()> add_extract_options(CLI::App& command, const ReadProgress& progress = {});

/// The files that these options name, once they are parsed: scans, stops, map. Stdin is /dev/stdin.
std::vector<std::string> extract_inputs(const CLI::App& command);

}  // namespace rangecal::ingest
