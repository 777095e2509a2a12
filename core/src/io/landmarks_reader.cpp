// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"

namespace rangecal::io {
namespace {

LabelIndex read_stops(const Files& files, Recording& recording) {
  recording.stops = stops_of(files.table("stops.csv"));
  LabelIndex index;
  for (const Stop& stop : recording.stops) index.insert(stop.label);
  return index;
}

// One row of observations.csv, with the reason why it cannot be used.
struct Row {
  int stop = 0, landmark = 0, repeat = 0;
  double range_m = 0.0, bearing_rad = 0.0;
  const char* unusable = nullptr;
};

struct Columns {
  std::size_t stop, landmark, range, bearing;
  std::optional<std::size_t> repeat, time;

  explicit Columns(const CsvTable& table)
      : stop(table.require("stop")),
        landmark(table.require("landmark")),
        range(table.require("range_m")),
        bearing(table.require("bearing_rad")),
        repeat(table.find("repeat")),
        time(table.find("time_s")) {}
};

// The range decides first; a reading whose bearing is missing cannot be used either.
void read_measurement(const CsvTable& table, std::size_t i, const Columns& columns, const Sensor& sensor, Row& row) {
  const auto range = table.number(i, columns.range);
  const auto bearing = table.number(i, columns.bearing);
  row.unusable = unusable(sensor, range);
  if (bearing && std::isfinite(*bearing)) {
    row.bearing_rad = checked_angle(table, i, columns.bearing, *bearing);
  } else if (row.unusable == nullptr) {
    row.unusable = bearing ? "not finite" : "missing";
  }
  row.range_m = range.value_or(0.0);
}

void read_observations(const Files& files, const RecordingHeader& header, bool listed,
                       const LabelIndex& stops, LabelIndex& landmarks, Recording& recording) {
  const CsvTable table = files.table("observations.csv");
  const Columns columns(table);
  if (table.rows() == 0) throw InputError(table.file(), 0, "", "holds a header and no rows");

  using Cell = std::pair<int, int>;
  std::vector<Row> rows(table.rows());
  std::map<Cell, CellLoss> losses;
  std::map<Cell, int> next_repeat;
  std::map<std::pair<Cell, int>, int> lines;   // line on which a (stop, landmark, repeat) stands
  for (std::size_t i = 0; i < table.rows(); ++i) {
    Row& row = rows[i];
    const std::string stop = table.label(i, columns.stop);
    const auto known = stops.find(stop);
    if (!known) table.fail(i, columns.stop, "unknown stop '" + stop + "': stops.csv does not list it");
    row.stop = *known;
    row.landmark = observed_landmark(table, i, columns.landmark, listed, header.landmark_radius_m, recording, landmarks);
    const Cell cell{row.stop, row.landmark};
    if (columns.repeat) {
      row.repeat = table.count(i, *columns.repeat);
      const auto [first, is_new] = lines.emplace(std::pair(cell, row.repeat), table.line(i));
      if (!is_new) {
        table.fail(i, *columns.repeat, "stop, landmark and repeat are those of row " + std::to_string(first->second));
      }
    } else {
      row.repeat = next_repeat[cell]++;
    }
    read_measurement(table, i, columns, recording.sensor, row);
    CellLoss& loss = losses[cell];
    if (row.unusable == nullptr || lost_at_limit(row.unusable)) ++loss.seen;
    if (lost_at_limit(row.unusable)) ++loss.lost;
  }

  Readings& readings = recording.readings;
  Counts& counts = recording.counts;
  CovariateColumns covariates(
      table, {"stop", "landmark", "repeat", "time_s", "range_m", "bearing_rad"}, readings.covariates);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Row& row = rows[i];
    const double time_s = columns.time ? table.finite(i, *columns.time) : 0.0;
    ++counts.read;
    if (row.unusable == nullptr && losses[{row.stop, row.landmark}].cut()) row.unusable = "cell cut by a limit";
    if (row.unusable != nullptr) {
      ++counts.dropped[row.unusable];
      continue;
    }
    ++counts.used;
    readings.stop.push_back(row.stop);
    readings.landmark.push_back(row.landmark);
    readings.repeat.push_back(row.repeat);
    if (columns.time) readings.time_s.push_back(time_s);
    readings.range_m.push_back(row.range_m);
    readings.bearing_rad.push_back(row.bearing_rad);
    readings.row.push_back(table.line(i));
    covariates.append(table, i);
  }
  counts.cells_left_out =
      static_cast<int>(std::count_if(losses.begin(), losses.end(), [](const auto& cell) { return cell.second.cut(); }));
}

void resolve_taped(const RecordingHeader& header, const LabelIndex& landmarks, Recording& recording) {
  const auto index_of = [&](const TapedDistance& taped, const std::string& label, const char* key) {
    const auto found = landmarks.find(label);
    if (!found) {
      throw InputError(header.file, taped.line, "",
                       "field '" + taped.field + "." + key + "': unknown landmark '" + label + "'");
    }
    return *found;
  };
  for (const TapedDistance& taped : header.taped) {
    recording.known_distances.push_back(
        {index_of(taped, taped.from, "from"), index_of(taped, taped.to, "to"), taped.distance_m, taped.sigma_m});
  }
}

}  // namespace

void read_landmarks_kind(const Files& files, const RecordingHeader& header, Recording& recording) {
  const LabelIndex stops = read_stops(files, recording);
  LabelIndex landmarks;
  const bool listed = read_landmark_list(files, header, recording, landmarks);
  read_observations(files, header, listed, stops, landmarks, recording);
  resolve_taped(header, landmarks, recording);
  read_truth(files, listed, stops, landmarks, recording);
}

}  // namespace rangecal::io
