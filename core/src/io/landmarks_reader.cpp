// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <set>
#include <unordered_map>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"

namespace rangecal::io {
namespace {

LabelIndex read_stops(const Files& files, Recording& recording) {
  if (!files.has("stops.csv") && files.has("pairs.csv"))
    throw InputError(files.name("recording.yaml"), 0, "",
                     "is of kind landmarks, but there is pairs.csv and no stops.csv: say 'kind: pairs'");
  recording.stops = stops_of(files.table("stops.csv"), recording.sigma_heading_rad);
  LabelIndex index;
  for (const Stop& stop : recording.stops) index.insert(stop.label);
  return index;
}

struct SightingColumns {
  std::size_t stop, landmark, range;
  std::optional<std::size_t> bearing, repeat, time;

  explicit SightingColumns(const CsvRows& rows)
      : stop(rows.require("stop")),
        landmark(rows.require("landmark")),
        range(rows.require("range_m")),
        bearing(rows.optional("bearing_rad")),
        repeat(rows.find("repeat")),
        time(rows.find("time_s")) {}
};

// A reading, with the reason why it cannot be used.
struct Sighting {
  double range_m = 0.0, bearing_rad = 0.0;
  const char* unusable = nullptr;
};

// The range decides first; where the file has bearings a reading without one cannot be used either.
Sighting measurement(const CsvRows& rows, const SightingColumns& columns, const Sensor& sensor) {
  const auto range = rows.number(columns.range);
  Sighting read{range.value_or(0.0), 0.0, unusable(sensor, range)};
  if (!columns.bearing) return read;
  const auto bearing = rows.number(*columns.bearing);
  if (bearing && std::isfinite(*bearing)) {
    read.bearing_rad = checked_angle(rows, *columns.bearing, *bearing);
  } else if (read.unusable == nullptr) {
    read.unusable = bearing ? "not finite" : "missing";
  }
  return read;
}

// All readings of one landmark from one stop: their losses, and which repeats there were: 0 .. next - 1 and
// those ahead.
struct Cell {
  CellLoss loss;
  int next = 0;
  std::unique_ptr<std::set<int>> ahead;

  bool take(int repeat) {  // false: it was there before
    if (repeat < next) return false;
    if (repeat > next) {
      if (!ahead) ahead = std::make_unique<std::set<int>>();
      return ahead->insert(repeat).second;
    }
    if (ahead && ahead->contains(repeat)) return false;
    for (++next; ahead && ahead->erase(next) > 0;) ++next;
    return true;
  }
};

class Cells {
 public:
  Cell& at(int stop, int landmark) {
    const std::uint64_t key = (static_cast<std::uint64_t>(stop) << 32) | static_cast<std::uint32_t>(landmark);
    if (!last_ || key != last_key_) last_ = &cells_[key];
    last_key_ = key;
    return *last_;
  }
  int cut() const {
    return static_cast<int>(
        std::count_if(cells_.begin(), cells_.end(), [](const auto& cell) { return cell.second.loss.cut(); }));
  }

 private:
  std::unordered_map<std::uint64_t, Cell> cells_;
  std::uint64_t last_key_ = 0;
  Cell* last_ = nullptr;  // rows of a cell mostly follow each other
};

// The current row has stop, landmark and repeat of an earlier one, which is looked for only now.
[[noreturn]] void fail_repeated(const Files& files, const CsvRows& rows, const SightingColumns& columns) {
  const std::string stop(rows.label(columns.stop)), landmark(rows.label(columns.landmark));
  const int repeat = rows.count(*columns.repeat);
  CsvRows again = files.rows("observations.csv");
  while (again.next() && again.line() < rows.line())
    if (again.label(columns.stop) == stop && again.label(columns.landmark) == landmark &&
        again.count(*columns.repeat) == repeat)
      rows.fail(*columns.repeat,
                "stop, landmark and repeat are those of row " + std::to_string(again.line()));
  rows.fail(*columns.repeat, "stop, landmark and repeat are those of an earlier row");
}

void leave_out_cut_cells(Cells& cells, CovariateColumns& covariates, GroupColumns& groups,
                         Recording& recording) {
  Readings& readings = recording.readings;
  Counts& counts = recording.counts;
  counts.cells_left_out = cells.cut();
  std::vector<char> unwanted;
  if (counts.cells_left_out > 0) {
    unwanted.resize(readings.size());
    for (std::size_t i = 0; i < readings.size(); ++i)
      unwanted[i] = cells.at(readings.stop[i], readings.landmark[i]).loss.cut();
    const auto lost = static_cast<int>(std::count(unwanted.begin(), unwanted.end(), 1));
    if (lost > 0) counts.dropped["cell cut by a limit"] = lost;
  }
  for (auto* column : {&readings.stop, &readings.landmark, &readings.repeat, &readings.row})
    leave_out(unwanted, *column);
  for (auto* column : {&readings.time_s, &readings.range_m, &readings.bearing_rad})
    leave_out(unwanted, *column);
  readings.covariates = covariates.finish(unwanted, recording.notes);
  groups.finish(unwanted, recording.groups);
  counts.used = static_cast<int>(readings.size());
}

void read_observations(const Files& files, const RecordingHeader& header, bool listed,
                       const LabelIndex& stops, LabelIndex& landmarks, Recording& recording) {
  CsvRows rows = files.rows("observations.csv");
  const SightingColumns columns(rows);
  CovariateColumns covariates(rows, {"stop", "landmark", "repeat", "time_s", "range_m", "bearing_rad"},
                              recording.groups.by);
  GroupColumns groups(rows, recording.groups);
  Cells cells;
  Readings& readings = recording.readings;
  Counts& counts = recording.counts;
  while (rows.next()) {
    ++counts.read;
    const std::string_view label = rows.label(columns.stop);
    const auto stop = stops.find(label);
    if (!stop)
      rows.fail(columns.stop, "unknown stop '" + std::string(label) + "': stops.csv does not list it");
    const int landmark =
        observed_landmark(rows, columns.landmark, listed, header.landmark_radius_m, recording, landmarks);
    Cell& cell = cells.at(*stop, landmark);
    const int repeat = columns.repeat ? rows.count(*columns.repeat) : cell.next;
    if (!cell.take(repeat)) fail_repeated(files, rows, columns);
    const Sighting read = measurement(rows, columns, recording.sensor);
    const double time_s = columns.time ? rows.finite(*columns.time) : 0.0;
    cell.loss.count(read.unusable);
    covariates.take(rows, read.unusable == nullptr);
    groups.take(rows, read.unusable == nullptr);
    if (read.unusable != nullptr) {
      ++counts.dropped[read.unusable];
      continue;
    }
    readings.stop.push_back(*stop);
    readings.landmark.push_back(landmark);
    readings.repeat.push_back(repeat);
    if (columns.time) readings.time_s.push_back(time_s);
    readings.range_m.push_back(read.range_m);
    if (columns.bearing) readings.bearing_rad.push_back(read.bearing_rad);
    readings.row.push_back(rows.line());
  }
  if (!columns.bearing) recording.notes.push_back("no column bearing_rad in observations.csv: ranges alone");
  if (counts.read == 0) throw InputError(rows.file(), 0, "", "holds a header and no rows");
  leave_out_cut_cells(cells, covariates, groups, recording);
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
    recording.known_distances.push_back({index_of(taped, taped.from, "from"), index_of(taped, taped.to, "to"),
                                         taped.distance_m, taped.sigma_m});
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
