// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/change/change_detector.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

namespace rangecal::app {

struct TrackJob {
  std::string input = "-", state, from, output;
  std::string changes;  ///< table of the alarms, written anew at each
  double watch = 0.0;   ///< readings between two false alarms against `from`; 0: no watch
  bool follow = false, approximate = false;
  std::string stops;  ///< readings of landmarks: a recording whose stops and landmarks the stream names
  double sigma_xy_m = 0.01, sigma_heading_rad = 0.0,
         radius_m = 0.0;     ///< of stops and landmarks that do not say
  bool random_walk = false;  ///< the stops' errors are those of the steps and add up
  int every = 1000;
  RecursiveOptions options;
  std::vector<std::string> given;  ///< the options on the command line that one kind of stream alone has
};

struct Tracked {
  std::optional<Calibration> calibration;  ///< none where no row could teach anything
  Counts counts;
  std::int64_t rows = 0, corrected = 0, malformed = 0;
  std::int64_t out_of_range = 0;  ///< flagged so, the nearest distance beside them; not among `corrected`
  double effective = 0.0;
  bool timed = false, landmarks = false;
  std::vector<ChangeAlarm> changes;  ///< named, and one that is still open
  std::vector<std::string> notes;
  std::string lost;    ///< what happened to the file that was followed; empty: nothing
  int stopped_by = 0;  ///< the signal, 0: none
};

/// Runs a stream to its end, or to SIGINT or SIGTERM. The state is saved every `every` rows and at the end, the output
/// flushed before it; on the next run output beyond the saved length is cut off and the file, after what was read of it was
/// compared, read on from the saved place.
/// Throws InputError for a stream without a column of readings and a state that does not fit, or is of another stream.
Tracked track(const TrackJob& job);

}  // namespace rangecal::app
