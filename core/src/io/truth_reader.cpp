// SPDX-License-Identifier: BSD-3-Clause
#include <set>

#include "io/recording_parts.hpp"

namespace rangecal::io {
namespace {

void read_true_stops(const CsvTable& table, const LabelIndex& stops, Recording& recording) {
  const std::size_t label = table.require("stop");
  const std::size_t x = table.require("x_m"), y = table.require("y_m"),
                    heading = table.require("heading_rad");
  recording.truth.stops.resize(recording.stops.size());
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const std::string stop = table.label(row, label);
    const auto index = stops.find(stop);
    if (!index) table.fail(row, label, "unknown stop '" + stop + "': stops.csv does not list it");
    std::optional<Pose2>& truth = recording.truth.stops[static_cast<std::size_t>(*index)];
    if (truth) table.fail(row, label, "stop '" + stop + "' is listed twice");
    truth = Pose2{table.finite(row, x), table.finite(row, y),
                  checked_angle(table, row, heading, table.finite(row, heading))};
  }
}

// Where landmarks.csv says which landmarks there are, a truth for another one is a mistake; where it does not, the
// landmark was just never observed.
void read_true_landmarks(const CsvTable& table, bool listed, const LabelIndex& landmarks,
                         Recording& recording) {
  const std::size_t label = table.require("landmark");
  const std::size_t x = table.require("x_m"), y = table.require("y_m");
  recording.truth.landmarks.resize(recording.landmarks.size());
  std::set<std::string> seen;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const std::string landmark = table.label(row, label);
    if (!seen.insert(landmark).second) table.fail(row, label, "landmark '" + landmark + "' is listed twice");
    const Eigen::Vector2d position(table.finite(row, x), table.finite(row, y));
    const auto index = landmarks.find(landmark);
    if (index) {
      recording.truth.landmarks[static_cast<std::size_t>(*index)] = position;
    } else if (listed) {
      table.fail(row, label, "unknown landmark '" + landmark + "': landmarks.csv does not list it");
    }
  }
}

}  // namespace

void read_truth(const Files& files, bool listed, const LabelIndex& stops, const LabelIndex& landmarks,
                Recording& recording) {
  if (files.has("truth_stops.csv")) read_true_stops(files.table("truth_stops.csv"), stops, recording);
  if (files.has("truth_landmarks.csv"))
    read_true_landmarks(files.table("truth_landmarks.csv"), listed, landmarks, recording);
}

}  // namespace rangecal::io
