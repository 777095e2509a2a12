// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// What a reader is told beside the files.
struct LoadOptions {
  std::vector<std::string> group_by =
      {};  ///< columns that say which readings belong together, in place of the files' own
};

/// Reads a recording folder (docs/formats.md: recording.yaml, observations.csv, stops.csv, ... or pairs.csv), validates it,
/// drops and counts unusable readings. Throws InputError with file, row and column for anything malformed.
/// Cost: linear in the number of rows.
Recording load_recording(const std::string& folder, const LoadOptions& options = {});

/// The recordings of one job. Also throws where two of them are one folder, or one table, also through links: their
/// readings would count twice.
std::vector<Recording> load_recordings(const std::vector<std::string>& folders,
                                       const LoadOptions& options = {});

/// One recording from texts in memory by the names of the folder's files ("recording.yaml", "observations.csv", ...); errors
/// name these.
Recording parse_recording(const std::map<std::string, std::string>& files, const LoadOptions& options = {});

/// Writes the recording into `folder` (created if missing) so that load_recording gives it back, readings
/// that were dropped excepted: numbers as the shortest text that reads back exactly, each file through a
/// temporary and a rename, so that none is left half-written. Files of the format that this recording has no
/// use for are removed. `maker`, where there is one, is named in a comment at the head of recording.yaml.
void save_recording(const Recording& recording, const std::string& folder, const std::string& maker = {});

/// What a recording is measured in: its description and its tables, whichever of them it has.
inline constexpr std::array measured_files = {"recording.yaml", "observations.csv", "pairs.csv", "stops.csv",
                                              "landmarks.csv"};
/// Those of them with its readings, one by its kind.
inline constexpr std::array reading_tables = {"observations.csv", "pairs.csv"};
/// What a simulated one is compared with.
inline constexpr std::array truth_files = {"truth_stops.csv", "truth_landmarks.csv"};

/// The files that recordings in these folders consist of, ground truth included, whether they are there or not.
std::vector<std::string> recording_files(const std::vector<std::string>& folders);

/// Throws InputError if the folder holds a recording, or tables of one, that no program made: neither a maker
/// is named in it, nor is there a record of its extraction. Measurements are not replaced by an output; a
/// ground truth does not say that there are none, since places may have been surveyed.
void require_replaceable(const std::string& folder);

}  // namespace rangecal
