// SPDX-License-Identifier: BSD-3-Clause
// Simulates recordings again from the model that a diagnosis stands by:
//   y = f(d) + delta r + s exp(v / 2) e + u,   bearing = theta + delta theta + sigma_theta exp(w / 2) e' + u'
// delta, v, w the effects' changes, e normal or Student-t, AR(1) over the repeats of a cell, u shared within
// a cell; both rounded to the effects' grids at last.
#include <algorithm>
#include <cmath>
#include <limits>

#include "diagnosis/calibrated.hpp"
#include "diagnosis/simulation_draw.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/without_readings.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"

namespace rangecal {
namespace {

using namespace diagnosis;

/// False of ranges alone, whose calibration has no sigma_theta.
bool reads_bearings(const SimulationModel& model) { return model.calibration.sigma_theta_rad.has_value(); }

/// The layout with a running number in `row`, so that rows are found again, and placeholders for what was
/// read.
std::vector<Recording> layout_of(const SimulationModel& model) {
  std::vector<Recording> layout = model.recordings;
  int index = 0;
  for (std::size_t r = 0; r < layout.size(); ++r) {
    Readings& readings = layout[r].readings;
    Pairs& pairs = layout[r].pairs;
    readings.landmark = model.landmark_read.empty() ? readings.landmark : model.landmark_read[r];
    readings.range_m.assign(readings.stop.size(), 1.0);
    readings.bearing_rad.assign(reads_bearings(model) ? readings.stop.size() : 0, 0.0);
    pairs.reading_m.assign(pairs.true_m.size(), 1.0);
    readings.row.resize(readings.size());
    pairs.row.resize(pairs.size());
    for (int& row : layout[r].kind == RecordingKind::pairs ? pairs.row : readings.row) row = index++;
  }
  return layout;
}

struct Errors {
  Dependence dependence;
  bool reciprocal = false;
};

Errors errors_of(const Model& model) {
  Errors errors;
  errors.dependence = dependence_of(model);
  for (const ActiveEffect& active : model)
    errors.reciprocal = errors.reciprocal || active.effect->noise_before_reciprocal();
  return errors;
}

/// A reading on all of the model's grids.
GridReading on_grids(const Model& model, GridReading reading) {
  for (const ActiveEffect& active : model)
    reading = active.effect->rounded(reading, active.parameters.data());
  return reading;
}

RowChanges changes_of(const SimulationModel& model, const Rows& rows, const CellGeometry& geometry,
                      const Model& effects) {
  // The readings are rounded at last, so grids add nothing here.
  RowChanges changes = row_changes(rows, geometry, without_grids(effects));
  std::vector<std::pair<const AddedChange*, std::size_t>> added;  // per reading, by running number
  for (std::size_t r = 0; r < model.recordings.size(); ++r) {
    const Recording& recording = model.recordings[r];
    const std::size_t count = recording.kind == RecordingKind::pairs ? recording.pairs.true_m.size()
                                                                     : recording.readings.stop.size();
    for (std::size_t i = 0; i < count; ++i)
      added.emplace_back(r < model.added.size() ? &model.added[r] : nullptr, i);
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto& [extra, at] = added[static_cast<std::size_t>(rows.file_row[i])];
    if (!extra) continue;
    const auto add = [&, at = at](Eigen::VectorXd& to, const std::vector<double>& column) {
      if (at < column.size()) to[static_cast<Eigen::Index>(i)] += column[at];
    };
    add(changes.range, extra->range_m);
    add(changes.bearing, extra->bearing_rad);
    add(changes.range_log_variance, extra->range_log_variance);
    add(changes.bearing_log_variance, extra->bearing_log_variance);
  }
  return changes;
}

/// The ranges that readings of the cells in sight will have: effects may refer to them, and the layout has placeholders.
void set_ranges(const CellGeometry& geometry, const VisibleRange& visible, EffectContext& context) {
  double nearest = std::numeric_limits<double>::infinity(), farthest = 0.0;
  for (std::size_t c = 0; c < geometry.d.size(); ++c) {
    if (!(geometry.f[c] > 0.0) || geometry.d[c] < visible.min_m || geometry.d[c] > visible.max_m) continue;
    nearest = std::min(nearest, geometry.f[c]);
    farthest = std::max(farthest, geometry.f[c]);
  }
  if (farthest > 0.0) context.range_min_m = nearest, context.range_max_m = farthest;
}

/// Leaves out the readings whose range is not positive or not finite.
void keep_real(Recording& recording) {
  const bool pairs = recording.kind == RecordingKind::pairs;
  std::vector<char> out;
  for (const double read : pairs ? recording.pairs.reading_m : recording.readings.range_m)
    out.push_back(!(std::isfinite(read) && read > 0.0));
  leave_out_readings(out, recording);
  recording.notes.clear();  // of the readings that these stand for
  recording.counts = Counts{};
  recording.counts.read = recording.counts.used =
      static_cast<int>(pairs ? recording.pairs.size() : recording.readings.size());
}

}  // namespace

std::vector<Recording> diagnosis::drawn_recordings(const SimulationModel& model, std::uint64_t seed,
                                                   const VisibleRange& visible) {
  if (model.recordings.empty())
    throw InputError("simulate: the diagnosis holds no recording to simulate again");
  const Calibration& c = model.calibration;
  const std::vector<Recording> layout = layout_of(model);
  auto [rows, state, effects] = calibrated(layout, c);
  rows.problem.stops = commanded_under(rows, effects);
  if (!rows.pairs) state.stops = draw_stops(rows.problem, state, seed_from("simulated stops", {seed}));

  const CellGeometry geometry = cell_geometry(rows, state);
  set_ranges(geometry, visible, rows.context);
  const RowChanges changes = changes_of(model, rows, geometry, effects);
  const Errors errors = errors_of(effects);
  std::vector<double> range(rows.size()), bearing(rows.size());  // by running number
  Random random(seed_from("simulated readings", {seed}));
  const SerialErrors serial(rows.sequence, errors.dependence.range_correlated_share,
                            errors.dependence.range_correlation);
  Eigen::VectorXd in_sequence;  // errors of readings in a sequence, of variance 1
  if (!serial.independent()) {
    in_sequence.resize(static_cast<Eigen::Index>(rows.size()));
    for (double& value : in_sequence) value = random.normal();
    in_sequence = serial.coloured(in_sequence);
  }
  for (int cell = 0; cell < rows.cell_count; ++cell) {
    const double f = geometry.f[cell], s = geometry.spread[cell];
    const double range_shared = errors.dependence.range_cell_sigma_m * random.normal();
    const double bearing_shared = errors.dependence.bearing_cell_sigma_rad * random.normal();
    double range_error = 0.0, bearing_error = 0.0;
    for (int i = rows.cell_begin[cell]; i < rows.cell_begin[cell + 1]; ++i) {
      const bool first = i == rows.cell_begin[cell];
      const auto follow = [first](double before, double rho, double fresh) {
        return first ? fresh : rho * before + std::sqrt(1.0 - rho * rho) * fresh;
      };
      range_error = follow(range_error, errors.dependence.range_correlation, random.normal());
      if (!serial.independent()) range_error = in_sequence[i];
      bearing_error = follow(bearing_error, errors.dependence.bearing_correlation, random.normal());
      double e = s * std::exp(0.5 * changes.range_log_variance[i]) * range_error + range_shared;
      e += tail_law_of(rows, geometry, effects, static_cast<std::size_t>(i)).draw(random);
      double y = errors.reciprocal ? 1.0 / (1.0 / f + e / (f * f)) : f + e;
      y += changes.range[i];
      const double direction =
          geometry.bearing[cell] + changes.bearing[i] + bearing_shared +
          state.sigma_theta_rad * std::exp(0.5 * changes.bearing_log_variance[i]) * bearing_error;
      const GridReading read = on_grids(effects, {.range_m = y, .bearing_rad = direction});
      const std::size_t at = static_cast<std::size_t>(rows.file_row[i]);
      range[at] = read.range_m;
      bearing[at] = rows.reads_bearings() ? wrap_angle(read.bearing_rad) : 0.0;
    }
  }

  std::vector<Recording> simulated = model.recordings;
  std::size_t at = 0;
  int stop = 0, landmark = 0;
  for (Recording& recording : simulated) {
    Readings& r = recording.readings;
    const std::size_t count =
        recording.kind == RecordingKind::pairs ? recording.pairs.true_m.size() : r.stop.size();
    const auto part = [&](const std::vector<double>& all) {
      return std::vector<double>(all.begin() + static_cast<long>(at),
                                 all.begin() + static_cast<long>(at + count));
    };
    if (recording.kind == RecordingKind::pairs) {
      recording.pairs.reading_m = part(range);
    } else {
      r.range_m = part(range);
      r.bearing_rad = reads_bearings(model) ? part(bearing) : std::vector<double>();
      recording.truth = Truth{};
      for (std::size_t k = 0; k < recording.stops.size(); ++k)
        recording.truth.stops.push_back(state.stops[stop++]);
      for (std::size_t l = 0; l < recording.landmarks.size(); ++l)
        recording.truth.landmarks.push_back(state.landmarks[landmark++]);
    }
    at += count;
  }
  return simulated;
}

std::vector<Recording> simulate(const SimulationModel& model, std::uint64_t seed) {
  std::vector<Recording> simulated = drawn_recordings(model, seed);
  for (Recording& recording : simulated) keep_real(recording);
  return simulated;
}

}  // namespace rangecal
