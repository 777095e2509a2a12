// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/change/change_detector.hpp"

namespace rangecal::app {

/// What a run leaves for the next one on the same stream (`rangecal-track/1`).
struct TrackState {
  std::string header;       ///< of the stream; empty where it has none
  std::string fingerprint;  ///< of the bytes taken; empty in states of 0.1.0
  std::int64_t offset = 0, line = 0, output_bytes = 0, rows = 0, corrected = 0, malformed = 0,
               next_estimate = 0, out_of_range = 0;  ///< the last not among `corrected`
  bool tells_outliers = true;  ///< each line of the output ends with a probability; not those begun by 0.1.0
  std::optional<Calibration> calibration;  ///< by which readings are corrected
  std::vector<ChangeAlarm> changes;
  nlohmann::ordered_json watch, calibrator;  ///< null: none
  nlohmann::ordered_json asked;  ///< options that the calibrator does not keep; null in states of 0.1.0
  nlohmann::ordered_json stops;  ///< what of --stops was used; null where there is none
};

std::string to_json(const TrackState& state);
/// Throws InputError or a JSON exception for a text that is no such state.
TrackState state_in(const std::string& text);

}  // namespace rangecal::app
