// SPDX-License-Identifier: BSD-3-Clause
#include <set>

#include "io/recording_parts.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::io {
namespace {

void read_true_stops(const std::string& path, const LabelIndex& stops, Recording& recording) {
  const CsvTable table = CsvTable::read(path);
  const std::size_t label = table.require("stop");
  const std::size_t x = table.require("x_m"), y = table.require("y_m"), heading = table.require("heading_rad");
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
void read_true_landmarks(const std::string& path, bool listed, const LabelIndex& landmarks, Recording& recording) {
  const CsvTable table = CsvTable::read(path);
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

void read_truth(const std::string& folder, bool listed, const LabelIndex& stops, const LabelIndex& landmarks,
                Recording& recording) {
  const std::string stop_path = path_in(folder, "truth_stops.csv");
  if (file_exists(stop_path)) read_true_stops(stop_path, stops, recording);
  const std::string landmark_path = path_in(folder, "truth_landmarks.csv");
  if (file_exists(landmark_path)) read_true_landmarks(landmark_path, listed, landmarks, recording);
}

}  // namespace rangecal::io
