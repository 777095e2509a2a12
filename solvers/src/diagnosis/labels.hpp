// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "diagnosis/bookkeeping.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal::diagnosis {

/// Landmarks whose cells at some stops lie where another landmark is, and the other way round: the labels are
/// put back in `recordings`. Positions are compared by medians over the stops, so fewer than half may be
/// wrong.
Bookkeeping correct_labels(std::vector<Recording>& recordings);

/// Readings of one landmark at one stop that lie in a direction in which the landmark is not: a label that was misread, or something
/// else that was taken for the landmark.
struct MisreadLabel {
  int stop = 0, landmark = 0;
  std::vector<std::size_t> readings;  ///< by their index
  double turned_rad = 0.0;  ///< bearing, less that of where all other stops see the landmark; the first one's
  int seen = -1;            ///< the landmark that stands where they lie, -1 where none does
};

/// Those of a recording of landmarks, after labels that were exchanged are put back. A reading counts where its bearing, less what the stop itself is turned by, is off by 12 robust standard
/// deviations of the bearings and across by 0.8 of the distance from the landmark to the next one. None of a landmark that is elsewhere from
/// some stop on: it was moved. None at all where more than a fiftieth of the cells count: then it is no misreading, and the search is
/// to tell.
std::vector<MisreadLabel> misread_labels(const Recording& recorded);

/// "T20 at stop 249, turned by 150 deg, where T6 stands": the misread labels of a recording, the first few of them.
std::string in_words(const std::vector<MisreadLabel>& misread, const Recording& recording);

/// The recording without these readings.
Recording without_misread(const Recording& recording, const std::vector<MisreadLabel>& misread);

}  // namespace rangecal::diagnosis
