// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::io {
namespace {

struct PairColumns {
  std::size_t truth, reading;
  std::optional<std::size_t> batch, time, landmark, bearing;

  explicit PairColumns(const CsvRows& rows)
      : truth(rows.require("true_m")),
        reading(rows.require("reading_m")),
        batch(rows.find("batch")),
        time(rows.find("time_s")),
        landmark(rows.find("landmark")),
        bearing(rows.find("bearing_rad")) {}
};

// A pair, with the reason why it cannot be used.
struct Pair {
  double true_m = 0.0, reading_m = 0.0, bearing_rad = 0.0;
  const char* unusable = nullptr;
};

Pair measurement(const CsvRows& rows, const PairColumns& columns, const Sensor& sensor) {
  const auto reading = rows.number(columns.reading), truth = rows.number(columns.truth);
  Pair read;
  read.unusable = unusable(sensor, reading);
  read.reading_m = reading.value_or(0.0);
  if (truth && std::isfinite(*truth)) {
    read.true_m = *truth;
    if (read.true_m <= 0.0) rows.fail(columns.truth, "the true distance is not positive");
  } else if (read.unusable == nullptr) {
    read.unusable = truth ? "not finite" : "missing";
  }
  if (!columns.bearing) return read;
  const auto bearing = rows.number(*columns.bearing);
  if (bearing && std::isfinite(*bearing)) {
    read.bearing_rad = checked_angle(rows, *columns.bearing, *bearing);
  } else if (read.unusable == nullptr) {
    read.unusable = bearing ? "not finite" : "missing";
  }
  return read;
}

// The batches met so far, with their losses.
struct Batches {
  LabelIndex index;
  std::vector<std::string> labels;
  std::vector<CellLoss> losses;

  int find(const CsvRows& rows, std::size_t column) {  // -1: of no batch
    if (rows.text(column).empty()) return -1;
    const std::string_view label = rows.label(column);
    if (const auto known = index.find(label)) return *known;
    if (index.size() == LabelIndex::most)
      rows.fail(column, "there are more than " + std::to_string(LabelIndex::most));
    labels.emplace_back(label);
    losses.emplace_back();
    return index.insert(label);
  }
  bool cut(int batch) const { return batch >= 0 && losses[static_cast<std::size_t>(batch)].cut(); }
  int cut() const {
    return static_cast<int>(
        std::count_if(losses.begin(), losses.end(), [](const CellLoss& loss) { return loss.cut(); }));
  }
};

// Without batches the cells are what was read at one true distance, wherever in the file: those that lost a reading
// at a limit, with their losses.
class CutDistances {
 public:
  void count(double true_m, const char* reason) {
    if (lost_at_limit(reason) && true_m > 0.0) losses_[true_m].count(reason);
  }
  void count_used(const Pairs& pairs) {
    if (losses_.empty()) return;
    for (const double true_m : pairs.true_m)
      if (const auto found = losses_.find(true_m); found != losses_.end()) found->second.count(nullptr);
  }
  bool cut(double true_m) const {
    const auto found = losses_.find(true_m);
    return found != losses_.end() && found->second.cut();
  }
  int cut() const {  // of which something is left to leave out
    return static_cast<int>(std::count_if(losses_.begin(), losses_.end(), [](const auto& loss) {
      return loss.second.cut() && loss.second.seen > loss.second.lost;
    }));
  }
  int lone() const {  // lost readings whose distance no other has
    return static_cast<int>(std::count_if(losses_.begin(), losses_.end(),
                                          [](const auto& loss) { return loss.second.seen == 1; }));
  }

 private:
  std::map<double, CellLoss> losses_;
};

// Where nine tenths of the readings or more have a distance of their own, no question about repeats can be asked, and
// no cell shows what a limit took.
void note_lone_distances(const std::string& file, const CutDistances& distances, Recording& recording) {
  std::vector<double> d = recording.pairs.true_m;
  const std::size_t size = d.size();
  std::size_t together = 0;
  for (std::size_t i = 1; i < size; ++i) together += d[i] == d[i - 1];
  if (size < 2 || 10 * together > size) return;
  std::sort(d.begin(), d.end());
  std::size_t alone = 0;
  for (std::size_t i = 0; i < size; ++i)
    alone += (i == 0 || d[i] != d[i - 1]) && (i + 1 == size || d[i] != d[i + 1]);
  if (10 * alone < 9 * size) return;
  std::string what = fmt::format(
      "there is no column 'batch', and {} of {} readings have a true_m that no other has: what only repeats tell cannot "
      "be asked",
      alone, size);
  if (distances.lone() > 0)
    what +=
        fmt::format("; {} more were lost at a limit of the sensor, and what is left near it leans inwards",
                    distances.lone());
  recording.notes.emplace_back(InputError(file, 0, "", what).what());
}

void leave_out_cut_pairs(const Batches& batches, const CutDistances& distances, CovariateColumns& covariates,
                         GroupColumns& groups, Recording& recording) {
  Pairs& pairs = recording.pairs;
  Counts& counts = recording.counts;
  counts.cells_left_out = batches.cut() + distances.cut();
  std::vector<char> unwanted;
  if (counts.cells_left_out > 0) {
    for (std::size_t i = 0; i < pairs.size(); ++i)
      unwanted.push_back(pairs.batch.empty() ? distances.cut(pairs.true_m[i]) : batches.cut(pairs.batch[i]));
    const auto lost = static_cast<int>(std::count(unwanted.begin(), unwanted.end(), 1));
    if (lost > 0) counts.dropped["cell cut by a limit"] = lost;
  }
  for (auto* column : {&pairs.batch, &pairs.landmark, &pairs.row}) leave_out(unwanted, *column);
  for (auto* column : {&pairs.true_m, &pairs.reading_m, &pairs.time_s, &pairs.bearing_rad})
    leave_out(unwanted, *column);
  pairs.covariates = covariates.finish(unwanted, recording.notes);
  groups.finish(unwanted, recording.groups);
  counts.used = static_cast<int>(pairs.size());
}

// Batches of which nothing is left get no index.
void number_batches(const Batches& batches, Pairs& pairs) {
  std::vector<int> kept(batches.labels.size(), -1);
  for (int& batch : pairs.batch) {
    if (batch < 0) continue;
    const auto old = static_cast<std::size_t>(batch);
    if (kept[old] < 0) {
      kept[old] = static_cast<int>(pairs.batch_labels.size());
      pairs.batch_labels.push_back(batches.labels[old]);
    }
    batch = kept[old];
  }
}

// Of the true distances of a batch. Encoders of rails jitter: what differs by less than 5 mm or 1 % is not asked about.
struct DistanceSpan {
  double low = std::numeric_limits<double>::infinity(), high = 0.0;
  bool wide() const { return high - low > std::max(0.005, 0.01 * low); }
};

void note_wide_batches(const std::string& file, Recording& recording) {
  const Pairs& pairs = recording.pairs;
  std::vector<DistanceSpan> spans(pairs.batch_labels.size());
  for (std::size_t i = 0; i < pairs.batch.size(); ++i) {
    if (pairs.batch[i] < 0) continue;
    DistanceSpan& span = spans[static_cast<std::size_t>(pairs.batch[i])];
    span.low = std::min(span.low, pairs.true_m[i]);
    span.high = std::max(span.high, pairs.true_m[i]);
  }
  const auto wide = [](const DistanceSpan& span) { return span.wide(); };
  const auto first = std::find_if(spans.begin(), spans.end(), wide);
  if (first == spans.end()) return;
  std::string what = fmt::format(
      "batch '{}' holds true distances from {:.6g} to {:.6g} m: a batch is read at one distance",
      pairs.batch_labels[static_cast<std::size_t>(first - spans.begin())], first->low, first->high);
  if (const auto more = std::count_if(first + 1, spans.end(), wide); more > 0)
    what += fmt::format("; {} more {} as well", more, more == 1 ? "does" : "do");
  recording.notes.emplace_back(InputError(file, 0, "true_m", what).what());
}

}  // namespace

namespace {

/// The true distance of every reading at its time + `offset_s`, straight between its device's neighbours in time. Readings
/// whose time lies beyond the device's first or last are dropped.
void move_in_time(double offset_s, Recording& recording) {
  Pairs& pairs = recording.pairs;
  std::map<int, std::vector<std::size_t>> devices;
  for (std::size_t i = 0; i < pairs.size(); ++i)
    devices[pairs.landmark.empty() ? 0 : pairs.landmark[i]].push_back(i);
  std::vector<double> moved(pairs.size());
  std::vector<char> unwanted(pairs.size());
  for (auto& [device, readings] : devices) {
    std::stable_sort(readings.begin(), readings.end(),
                     [&](std::size_t a, std::size_t b) { return pairs.time_s[a] < pairs.time_s[b]; });
    for (const std::size_t i : readings) {
      const double t = pairs.time_s[i] + offset_s;
      const auto above = std::lower_bound(readings.begin(), readings.end(), t,
                                          [&](std::size_t a, double time) { return pairs.time_s[a] < time; });
      unwanted[i] = above == readings.end() || (above == readings.begin() && pairs.time_s[*above] > t);
      if (unwanted[i]) continue;
      const std::size_t to = *above, from = above == readings.begin() ? to : *(above - 1);
      const double span = pairs.time_s[to] - pairs.time_s[from];
      const double share = span > 0.0 ? (t - pairs.time_s[from]) / span : 1.0;
      moved[i] = (1.0 - share) * pairs.true_m[from] + share * pairs.true_m[to];
    }
  }
  pairs.true_m = std::move(moved);
  if (const auto lost = static_cast<int>(std::count(unwanted.begin(), unwanted.end(), 1)); lost > 0)
    recording.counts.dropped["no true distance at its time"] = lost;
  for (auto* column : {&pairs.batch, &pairs.landmark, &pairs.row, &recording.groups.of})
    leave_out(unwanted, *column);
  for (auto* column : {&pairs.true_m, &pairs.reading_m, &pairs.time_s, &pairs.bearing_rad})
    leave_out(unwanted, *column);
  for (auto& [name, column] : pairs.covariates) leave_out(unwanted, column);
  recording.counts.used = static_cast<int>(pairs.size());
}

}  // namespace

void read_pairs_kind(const Files& files, const RecordingHeader& header, Recording& recording) {
  CsvRows rows = files.rows("pairs.csv");
  const PairColumns columns(rows);
  LabelIndex landmarks;
  const bool listed = read_landmark_list(files, header, recording, landmarks);
  if (!header.taped.empty()) {
    throw InputError(header.file, header.taped.front().line, "",
                     "field 'known_distances': has no meaning in a recording of kind pairs");
  }
  CovariateColumns covariates(rows, {"true_m", "reading_m", "batch", "time_s", "landmark", "bearing_rad"},
                              recording.groups.by);
  GroupColumns groups(rows, recording.groups);
  Batches batches;
  CutDistances distances;
  Pairs& pairs = recording.pairs;
  Counts& counts = recording.counts;
  while (rows.next()) {
    ++counts.read;
    const int batch = columns.batch ? batches.find(rows, *columns.batch) : -1;
    const int landmark = columns.landmark ? observed_landmark(rows, *columns.landmark, listed,
                                                              header.landmark_radius_m, recording, landmarks)
                                          : -1;
    const Pair read = measurement(rows, columns, recording.sensor);
    const double time_s = columns.time ? rows.finite(*columns.time) : 0.0;
    if (batch >= 0) batches.losses[static_cast<std::size_t>(batch)].count(read.unusable);
    if (!columns.batch) distances.count(read.true_m, read.unusable);
    covariates.take(rows, read.unusable == nullptr);
    groups.take(rows, read.unusable == nullptr);
    if (read.unusable != nullptr) {
      ++counts.dropped[read.unusable];
      continue;
    }
    if (columns.batch) pairs.batch.push_back(batch);
    if (columns.landmark) pairs.landmark.push_back(landmark);
    if (columns.time) pairs.time_s.push_back(time_s);
    if (columns.bearing) pairs.bearing_rad.push_back(read.bearing_rad);
    pairs.true_m.push_back(read.true_m);
    pairs.reading_m.push_back(read.reading_m);
    pairs.row.push_back(rows.line());
  }
  if (counts.read == 0) throw InputError(rows.file(), 0, "", "holds a header and no rows");
  distances.count_used(pairs);
  leave_out_cut_pairs(batches, distances, covariates, groups, recording);
  if (header.reference_offset_s != 0.0) {
    if (!columns.time)
      throw InputError(
          header.file, header.reference_line, "",
          "field 'reference.time_offset_s': needs times (a column time_s of " + rows.file() + ")");
    move_in_time(header.reference_offset_s, recording);
    recording.notes.emplace_back(
        InputError(
            header.file, header.reference_line, "",
            fmt::format("readings are held against true_m at their time + {:g} s (reference.time_offset_s)",
                        header.reference_offset_s))
            .what());
  }
  number_batches(batches, pairs);
  if (columns.batch)
    note_wide_batches(rows.file(), recording);
  else
    note_lone_distances(rows.file(), distances, recording);
}

}  // namespace rangecal::io
