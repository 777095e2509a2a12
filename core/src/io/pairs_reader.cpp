// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::io {
namespace {

// One row of pairs.csv, with the reason why it cannot be used.
struct Row {
  int batch = -1, landmark = -1;
  double true_m = 0.0, reading_m = 0.0, bearing_rad = 0.0;
  const char* unusable = nullptr;
};

struct Columns {
  std::size_t truth, reading;
  std::optional<std::size_t> batch, time, landmark, bearing;

  explicit Columns(const CsvTable& table)
      : truth(table.require("true_m")),
        reading(table.require("reading_m")),
        batch(table.find("batch")),
        time(table.find("time_s")),
        landmark(table.find("landmark")),
        bearing(table.find("bearing_rad")) {}
};

void read_measurement(const CsvTable& table, std::size_t i, const Columns& columns, const Sensor& sensor, Row& row) {
  const auto reading = table.number(i, columns.reading);
  const auto truth = table.number(i, columns.truth);
  row.unusable = unusable(sensor, reading);
  row.reading_m = reading.value_or(0.0);
  if (truth && std::isfinite(*truth)) {
    row.true_m = *truth;
    if (row.true_m <= 0.0) table.fail(i, columns.truth, "the true distance is not positive");
  } else if (row.unusable == nullptr) {
    row.unusable = truth ? "not finite" : "missing";
  }
  if (!columns.bearing) return;
  const auto bearing = table.number(i, *columns.bearing);
  if (bearing && std::isfinite(*bearing)) {
    row.bearing_rad = checked_angle(table, i, *columns.bearing, *bearing);
  } else if (row.unusable == nullptr) {
    row.unusable = bearing ? "not finite" : "missing";
  }
}

}  // namespace

void read_pairs_kind(const Files& files, const RecordingHeader& header, Recording& recording) {
  const CsvTable table = files.table("pairs.csv");
  const Columns columns(table);
  if (table.rows() == 0) throw InputError(table.file(), 0, "", "holds a header and no rows");
  LabelIndex landmarks;
  const bool listed = read_landmark_list(files, header, recording, landmarks);
  if (!header.taped.empty()) {
    throw InputError(header.file, header.taped.front().line, "",
                     "field 'known_distances': has no meaning in a recording of kind pairs");
  }

  std::vector<Row> rows(table.rows());
  LabelIndex batches;
  std::vector<std::string> batch_labels;
  std::vector<CellLoss> losses;
  for (std::size_t i = 0; i < table.rows(); ++i) {
    Row& row = rows[i];
    if (columns.batch && !table.text(i, *columns.batch).empty()) {
      const std::string label = table.label(i, *columns.batch);
      row.batch = batches.insert(label);
      if (batches.size() > losses.size()) {
        losses.emplace_back();
        batch_labels.push_back(label);
      }
    }
    if (columns.landmark) {
      row.landmark =
          observed_landmark(table, i, *columns.landmark, listed, header.landmark_radius_m, recording, landmarks);
    }
    read_measurement(table, i, columns, recording.sensor, row);
    if (row.batch < 0) continue;
    CellLoss& loss = losses[static_cast<std::size_t>(row.batch)];
    if (row.unusable == nullptr || lost_at_limit(row.unusable)) ++loss.seen;
    if (lost_at_limit(row.unusable)) ++loss.lost;
  }

  Pairs& pairs = recording.pairs;
  Counts& counts = recording.counts;
  CovariateColumns covariates(table, {"true_m", "reading_m", "batch", "time_s", "landmark", "bearing_rad"},
                              pairs.covariates);
  std::vector<int> kept(losses.size(), -1);   // batches of which nothing is left get no index
  for (std::size_t i = 0; i < rows.size(); ++i) {
    Row& row = rows[i];
    const double time_s = columns.time ? table.finite(i, *columns.time) : 0.0;
    ++counts.read;
    const auto batch = static_cast<std::size_t>(std::max(row.batch, 0));
    if (row.unusable == nullptr && row.batch >= 0 && losses[batch].cut()) row.unusable = "cell cut by a limit";
    if (row.unusable != nullptr) {
      ++counts.dropped[row.unusable];
      continue;
    }
    ++counts.used;
    if (columns.batch) {
      if (row.batch >= 0 && kept[batch] < 0) {
        kept[batch] = static_cast<int>(pairs.batch_labels.size());
        pairs.batch_labels.push_back(batch_labels[batch]);
      }
      pairs.batch.push_back(row.batch >= 0 ? kept[batch] : -1);
    }
    pairs.true_m.push_back(row.true_m);
    pairs.reading_m.push_back(row.reading_m);
    if (columns.landmark) pairs.landmark.push_back(row.landmark);
    if (columns.time) pairs.time_s.push_back(time_s);
    if (columns.bearing) pairs.bearing_rad.push_back(row.bearing_rad);
    pairs.row.push_back(table.line(i));
    covariates.append(table, i);
  }
  counts.cells_left_out =
      static_cast<int>(std::count_if(losses.begin(), losses.end(), [](const CellLoss& loss) { return loss.cut(); }));
}

}  // namespace rangecal::io
