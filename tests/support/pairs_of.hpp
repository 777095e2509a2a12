// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal::testing {

/// A recording of readings at known distances and nothing else.
inline Recording pairs_of(std::vector<double> true_m, std::vector<double> reading_m) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.counts.read = recording.counts.used = static_cast<int>(true_m.size());
  recording.pairs.true_m = std::move(true_m);
  recording.pairs.reading_m = std::move(reading_m);
  return recording;
}

}  // namespace rangecal::testing
