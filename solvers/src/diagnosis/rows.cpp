// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/rows.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <tuple>

#include "joint_ml/blocks.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/blocks.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/landmarks/cell_order.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double not_known = std::numeric_limits<double>::quiet_NaN();

void add_covariates(const Covariates& columns, std::size_t row, Rows& rows) {
  for (const std::string& name : rows.context.covariates) {
    const auto found = columns.find(name);
    rows.covariates.push_back(found == columns.end() ? not_known : found->second[row]);
  }
}

/// What the readings of one setting have in common: stretch of the file, batch, group, true distance, device and bearing. A distance
/// that comes again elsewhere in the file, or because it was noted to a centimetre, is no repeat of what was read then.
using Setting = std::tuple<int, int, int, double, int, double>;

std::vector<Setting> settings_of_pairs(const Recording& recording) {
  const Pairs& p = recording.pairs;
  const std::vector<int>& group = recording.groups.of;
  const Blocks blocks = blocks_of(recording);
  const bool stretches = blocks.kind == BlockKind::stretches;
  std::vector<Setting> settings;
  for (std::size_t i = 0; i < p.size(); ++i)
    settings.emplace_back(stretches ? blocks.of[i] : 0, p.batch.empty() ? 0 : p.batch[i],
                          group.empty() ? 0 : group[i], p.true_m[i], p.landmark.empty() ? 0 : p.landmark[i],
                          p.bearing_rad.empty() ? 0.0 : p.bearing_rad[i]);
  return settings;
}

/// True of known distances that were read one after another on the way, hardly any of them several times in a row.
bool in_sequence(const Recording& recording, const std::vector<Setting>& settings) {
  constexpr double most_repeats = 0.2;
  constexpr std::size_t fewest = 60;
  const Pairs& p = recording.pairs;
  if (!p.batch.empty() || p.size() < fewest || recording.reference.sigma_m > 0.0) return false;
  const std::set<Setting> distinct(settings.begin(), settings.end());
  return static_cast<double>(distinct.size()) >= (1.0 - most_repeats) * static_cast<double>(p.size());
}

/// Cell of every pair, numbered as the file opens them; a reading in no batch of a file that has some stands alone, as all do
/// in a sequence.
std::vector<int> cells_of_pairs(const Recording& recording) {
  const Pairs& p = recording.pairs;
  const std::vector<Setting> settings = settings_of_pairs(recording);
  std::map<Setting, int> known;
  std::vector<int> cell(p.size());
  if (in_sequence(recording, settings)) {
    std::iota(cell.begin(), cell.end(), 0);
    return cell;
  }
  int count = 0;
  for (std::size_t i = 0; i < p.size(); ++i) {
    if (!p.batch.empty() && p.batch[i] < 0) {
      cell[i] = count++;
      continue;
    }
    const auto [found, opens] = known.try_emplace(settings[i], count);
    count += opens;
    cell[i] = found->second;
  }
  return cell;
}

/// The pairs cell by cell, those of a cell as they stand in the file.
std::vector<std::size_t> pairs_in_order(const std::vector<int>& cell) {
  std::vector<std::size_t> order(cell.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return cell[a] < cell[b]; });
  return order;
}

void append_landmark_rows(const Recording& recording, int first_stop, int first_landmark, double first_time,
                          std::span<const int> block, Rows& rows) {
  const Readings& r = recording.readings;
  const std::vector<std::size_t> order = cell_order(r);
  for (std::size_t j = 0; j < order.size(); ++j) {
    const std::size_t i = order[j];
    if (j == 0 || !same_cell(r, i, order[j - 1])) {
      rows.cell_begin.push_back(static_cast<int>(rows.size()));
      ++rows.cell_count;
    }
    rows.cell.push_back(rows.cell_count - 1);
    rows.stop.push_back(first_stop + r.stop[i]);
    rows.landmark.push_back(first_landmark + r.landmark[i]);
    rows.repeat.push_back(static_cast<int>(rows.size()) - rows.cell_begin.back());
    rows.file_row.push_back(r.row.empty() ? 0 : r.row[i]);
    rows.range_m.push_back(r.range_m[i]);
    rows.bearing_rad.push_back(r.has_bearings() ? r.bearing_rad[i] : 0.0);
    rows.time_s.push_back(r.time_s.empty() ? 0.0 : r.time_s[i] - first_time);
    rows.radius_m.push_back(recording.landmarks[r.landmark[i]].radius_m);
    rows.heading_rad.push_back(recording.stops[r.stop[i]].commanded.heading_rad);
    rows.block.push_back(block[i]);
    add_covariates(r.covariates, i, rows);
  }
}

/// One cell of pairs of the recording of that index, its readings the rows from `begin` on; its true distance is known to
/// `sigma_m`.
void append_cell_of_pairs(double true_m, double sigma_m, int begin, int recording, Rows& rows) {
  JointProblem& problem = rows.problem;
  Cells& c = problem.cells;
  const auto count = static_cast<Eigen::Index>(rows.size()) - begin;
  const Eigen::Map<const Eigen::ArrayXd> readings(rows.range_m.data() + begin, count);
  const double mean = readings.mean();
  StopPrior prior;
  prior.commanded = {-rows.curve.scale.of(true_m), 0.0, 0.0};
  prior.sigma_xy_m = std::abs(rows.curve.scale.slope(true_m)) * sigma_m;
  prior.place = problem.place_count++;
  prior.recording = recording;
  c.stop.push_back(problem.stop_count());
  problem.stops.push_back(prior);
  problem.sigma_s_shared.push_back(0);
  c.landmark.push_back(0);
  for (auto* column : {&c.count, &c.range_weight, &c.bearing_weight})
    column->push_back(static_cast<double>(count));
  c.range_mean.push_back(mean);
  c.range_mean_square.push_back((readings - mean).square().mean());
  c.bearing_mean.push_back(0.0);
  // Its residual is zero: at SilentBearing::sigma_theta_rad the slope by log sigma_theta is too.
  c.bearing_mean_square.push_back(1.0);
  c.radius_m.push_back(0.0);
  problem.readings += static_cast<double>(count);
}

/// Rate of every true distance [m/s]: between the readings of its device before and after, as far as they lie within seconds.
std::vector<double> rates_of_pairs(const Pairs& p) {
  constexpr double near_s = 2.0;
  std::vector<double> rate(p.size(), 0.0);
  if (p.time_s.empty()) return rate;
  const auto device = [&](std::size_t i) { return p.landmark.empty() ? 0 : p.landmark[i]; };
  std::vector<std::size_t> order(p.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return std::pair(device(a), p.time_s[a]) < std::pair(device(b), p.time_s[b]);
  });
  for (std::size_t j = 0; j < order.size(); ++j) {
    const std::size_t i = order[j];
    const auto is_near = [&](std::size_t k) {
      return device(k) == device(i) && std::abs(p.time_s[k] - p.time_s[i]) <= near_s;
    };
    const std::size_t before = j > 0 && is_near(order[j - 1]) ? order[j - 1] : i,
                      after = j + 1 < order.size() && is_near(order[j + 1]) ? order[j + 1] : i;
    const double time = p.time_s[after] - p.time_s[before];
    if (time > 0.0) rate[i] = (p.true_m[after] - p.true_m[before]) / time;
  }
  return rate;
}

/// The readings of the rows from `first` on in order of time, without times of the file, those of every device and group for
/// themselves.
void append_sequence(const Recording& recording, std::span<const std::size_t> order, int first, Rows& rows) {
  constexpr double shortest = 0.01;  // gap: readings at one time are not one reading
  const Pairs& p = recording.pairs;
  const std::vector<int>& group = recording.groups.of;
  std::vector<int> sorted(order.size());
  std::iota(sorted.begin(), sorted.end(), 0);
  const auto chain = [&](int row) {
    const std::size_t i = order[static_cast<std::size_t>(row)];
    return std::pair(group.empty() ? 0 : group[i], p.landmark.empty() ? 0 : p.landmark[i]);
  };
  const auto at = [&](int row) {
    const std::size_t i = order[static_cast<std::size_t>(row)];
    return p.time_s.empty() ? static_cast<double>(i) : p.time_s[i];
  };
  std::stable_sort(sorted.begin(), sorted.end(),
                   [&](int a, int b) { return std::pair(chain(a), at(a)) < std::pair(chain(b), at(b)); });
  std::vector<double> gaps;
  for (std::size_t j = 1; j < sorted.size(); ++j)
    if (chain(sorted[j]) == chain(sorted[j - 1])) gaps.push_back(at(sorted[j]) - at(sorted[j - 1]));
  const double usual = gaps.empty() ? 0.0 : upper_median(gaps);
  Sequence& sequence = rows.sequence;
  sequence.before.resize(static_cast<std::size_t>(first) + order.size(), -1);
  sequence.gap.resize(sequence.before.size(), 0.0);
  for (std::size_t j = 0, begin = 0; j < sorted.size(); ++j) {
    sequence.order.push_back(first + sorted[j]);
    const bool starts = j == 0 || chain(sorted[j]) != chain(sorted[j - 1]);
    if (starts) begin = j;
    rows.context.longest_sequence = std::max(rows.context.longest_sequence, static_cast<int>(j - begin) + 1);
    if (starts) continue;
    const auto row = static_cast<std::size_t>(first + sorted[j]);
    sequence.before[row] = first + sorted[j - 1];
    const double gap = at(sorted[j]) - at(sorted[j - 1]);
    sequence.gap[row] = std::max(shortest, usual > 0.0 ? gap / usual : 1.0);
  }
}

void append_pair_rows(const Recording& recording, int index, int first_landmark, double first_time,
                      std::span<const int> block, bool sequence, Rows& rows) {
  const Pairs& p = recording.pairs;
  const std::vector<int> cell = cells_of_pairs(recording);
  const std::vector<std::size_t> order = pairs_in_order(cell);
  const std::vector<double> rate_mps = rates_of_pairs(p);
  const auto first_row = static_cast<int>(rows.size());
  for (std::size_t j = 0; j < order.size(); ++j) {
    const std::size_t i = order[j];
    if (j == 0 || cell[i] != cell[order[j - 1]]) {
      rows.cell_begin.push_back(static_cast<int>(rows.size()));
      ++rows.cell_count;
    }
    rows.cell.push_back(rows.cell_count - 1);
    rows.stop.push_back(rows.cell_count - 1);
    rows.landmark.push_back(p.landmark.empty() ? 0 : first_landmark + p.landmark[i]);
    rows.repeat.push_back(static_cast<int>(rows.size()) - rows.cell_begin.back());
    rows.file_row.push_back(p.row.empty() ? 0 : p.row[i]);
    rows.range_m.push_back(p.reading_m[i]);
    rows.bearing_rad.push_back(p.bearing_rad.empty() ? 0.0 : p.bearing_rad[i]);
    rows.time_s.push_back(p.time_s.empty() ? 0.0 : p.time_s[i] - first_time);
    rows.radius_m.push_back(0.0);
    rows.heading_rad.push_back(0.0);
    rows.block.push_back(block[i]);
    rows.rate_mps.push_back(rate_mps[i]);
    add_covariates(p.covariates, i, rows);
    if (j + 1 == order.size() || cell[order[j + 1]] != cell[i])
      append_cell_of_pairs(p.true_m[i], recording.reference.sigma_m, rows.cell_begin.back(), index, rows);
  }
  if (sequence) append_sequence(recording, order, first_row, rows);
}

void fill_context(std::span<const Recording> recordings, Rows& rows) {
  EffectContext& context = rows.context;
  context.kind = rows.pairs ? RecordingKind::pairs : RecordingKind::landmarks;
  context.reads_bearings = rows.problem.reads_bearings;
  context.carrier = carrier_of(recordings.front());
  for (const Recording& recording : recordings)
    if (carrier_of(recording) != context.carrier) context.carrier = Carrier::not_known;
  context.stop_count = rows.problem.stop_count();
  for (const Recording& recording : recordings)
    for (const Landmark& landmark : recording.landmarks) {
      context.landmark_labels.push_back(landmark.label);
      context.landmark_radius_m.push_back(landmark.radius_m);
    }
  context.landmark_count = static_cast<int>(context.landmark_labels.size());
  double cosines = 0.0, sines = 0.0;
  for (int k = 0; k < rows.problem.stop_count(); ++k) {
    const StopPrior& prior = rows.problem.stops[k];
    context.commanded.push_back(prior.commanded);
    const bool starts = k == 0 || prior.recording != rows.problem.stops[k - 1].recording;
    const Pose2& before = rows.problem.stops[std::max(k - 1, 0)].commanded;
    const double step = std::hypot(prior.commanded.x_m - before.x_m, prior.commanded.y_m - before.y_m);
    context.path_m.push_back(starts ? 0.0 : context.path_m.back() + step);
    cosines += std::cos(prior.commanded.heading_rad);
    sines += std::sin(prior.commanded.heading_rad);
  }
  const double mean_length = std::min(1.0, std::hypot(cosines, sines) / std::max(context.stop_count, 1));
  context.headings = std::sqrt(std::max(0.0, -2.0 * std::log(std::max(mean_length, 1e-12))));
  if (rows.size() > 0) {  // the readings stand for the distances: start grids need no more
    const auto [nearest, farthest] = std::minmax_element(rows.range_m.begin(), rows.range_m.end());
    if (rows.problem.reads_bearings) context.largest_bearing_rad = 0.0;
    for (double bearing : rows.bearing_rad)
      context.largest_bearing_rad = std::max(context.largest_bearing_rad, std::abs(bearing));
    context.range_min_m = *nearest;
    context.range_max_m = *farthest;
  }
  for (double rate : rows.rate_mps)
    context.largest_rate_mps = std::max(context.largest_rate_mps, std::abs(rate));
  if (rows.size() > 0) context.duration_s = *std::max_element(rows.time_s.begin(), rows.time_s.end());
  if (context.duration_s > 0.0) {
    context.stop_time_s.assign(context.stop_count, 0.0);
    std::vector<char> seen(context.stop_count, 0);
    for (std::size_t i = 0; i < rows.size(); ++i) {
      double& first = context.stop_time_s[rows.stop[i]];
      first = seen[rows.stop[i]] ? std::min(first, rows.time_s[i]) : rows.time_s[i];
      seen[rows.stop[i]] = 1;
    }
    for (std::size_t i = 0; i < rows.size(); ++i)
      context.stay_s = std::max(context.stay_s, rows.time_s[i] - context.stop_time_s[rows.stop[i]]);
  }
  for (int c = 0; c < rows.cell_count; ++c)
    context.largest_cell =
        std::max<double>(context.largest_cell, rows.cell_begin[c + 1] - rows.cell_begin[c]);
  const std::set<double> radii(rows.radius_m.begin(), rows.radius_m.end());
  context.several_radii = radii.size() > 1;
}

/// What each column is, by the first recording that has it, and its mean and spread over all.
void summarise_columns(std::span<const Recording> recordings, Rows& rows) {
  const std::size_t columns = rows.context.covariates.size();
  for (std::size_t c = 0; c < columns; ++c) {
    const std::string& name = rows.context.covariates[c];
    const auto has = [&](const Recording& recording) { return covariates_of(recording).count(name) > 0; };
    ColumnSummary summary;
    summary.role = column_of(*std::find_if(recordings.begin(), recordings.end(), has), name).role;
    double count = 0.0, squares = 0.0;  // Welford's recurrence
    for (std::size_t i = 0; i < rows.size(); ++i) {
      const double x = rows.covariates[i * columns + c];
      if (!std::isfinite(x)) continue;
      const double step = x - summary.mean;
      summary.mean += step / ++count;
      squares += step * (x - summary.mean);
    }
    summary.std_dev = count > 1.0 ? std::sqrt(squares / (count - 1.0)) : 0.0;
    rows.context.columns.push_back(summary);
  }
}

double first_time_of(const Recording& recording) {
  const std::vector<double>& times =
      recording.kind == RecordingKind::pairs ? recording.pairs.time_s : recording.readings.time_s;
  return times.empty() ? 0.0 : *std::min_element(times.begin(), times.end());
}

/// A known distance's line of sight, which lies along x.
Sight along_x(const Eigen::Vector2d& landmark, const Pose2& stop) {
  const double v = landmark.x() - stop.x_m, sign = std::copysign(1.0, v);
  Sight sight;
  sight.axis_distance = sight.d = std::abs(v);
  sight.n = {sign, 0.0};
  sight.t = {0.0, sign};
  return sight;
}

}  // namespace

std::vector<std::size_t> row_order(const Recording& recording) {
  return recording.kind == RecordingKind::pairs ? pairs_in_order(cells_of_pairs(recording))
                                                : cell_order(recording.readings);
}

Rows make_rows(std::span<const Recording> recordings, const SeedCurve& curve) {
  if (recordings.empty()) throw InputError("no recording given");
  Rows rows;
  rows.pairs = recordings[0].kind == RecordingKind::pairs;
  rows.curve = curve;
  if (!rows.pairs && !curve.scale.is_distance())
    throw InputError(recordings[0].path + ": a " + to_string(curve.scale.family) +
                     " curve is for known distances (kind pairs)");
  std::set<std::string> names;
  for (const Recording& recording : recordings) {
    rows.range_min_m = std::max(rows.range_min_m, recording.sensor.range_min_m);
    rows.range_max_m = std::min(rows.range_max_m, recording.sensor.range_max_m);
    if ((recording.kind == RecordingKind::pairs) != rows.pairs)
      throw InputError(recording.path + ": pairs and landmark recordings cannot be diagnosed together");
    for (const auto& [name, values] : covariates_of(recording)) names.insert(name);
  }
  rows.context.covariates.assign(names.begin(), names.end());
  if (!rows.pairs) rows.problem = make_joint_problem(recordings);
  const bool sequence =
      rows.pairs && std::all_of(recordings.begin(), recordings.end(),
                                [](const Recording& r) { return in_sequence(r, settings_of_pairs(r)); });
  const BlocksOfAll blocks = blocks_of_all(recordings);
  rows.blocks = blocks.words;
  int first_stop = 0, first_landmark = 0, index = 0;
  for (const Recording& recording : recordings) {
    const std::span<const int> block = std::span(blocks.of).subspan(
        rows.size(), rows.pairs ? recording.pairs.size() : recording.readings.size());
    if (rows.pairs)
      append_pair_rows(recording, index, first_landmark, first_time_of(recording), block, sequence, rows);
    else
      append_landmark_rows(recording, first_stop, first_landmark, first_time_of(recording), block, rows);
    first_stop += static_cast<int>(recording.stops.size());
    first_landmark += static_cast<int>(recording.landmarks.size());
    ++index;
  }
  rows.cell_begin.push_back(static_cast<int>(rows.size()));
  if (rows.pairs) {
    rows.problem.landmark_radius_m = {0.0};
    rows.problem.landmark_recording = {0};
    rows.problem.cells.stop_begin.resize(rows.problem.stops.size() + 1);
    std::iota(rows.problem.cells.stop_begin.begin(), rows.problem.cells.stop_begin.end(), 0);
    rows.nll_offset = -SilentBearing::nll(rows.problem.readings);
  }
  fill_context(recordings, rows);
  summarise_columns(recordings, rows);
  return rows;
}

CellGeometry cell_geometry(const Rows& rows, const JointState& state) {
  const Cells& c = rows.problem.cells;
  CellGeometry g;
  g.spread_power = state.noise.power_of_f();
  g.sigma_theta_rad = state.sigma_theta_rad;
  const std::size_t cells = c.size();
  for (auto* column : {&g.d, &g.axis_distance, &g.bearing, &g.f, &g.slope, &g.curvature, &g.spread, &g.u})
    column->resize(cells);
  g.n.resize(cells);
  g.t.resize(cells);
  for (std::size_t i = 0; i < cells; ++i) {
    const Sight sight = rows.pairs
                            ? along_x(state.landmarks[c.landmark[i]], state.stops[c.stop[i]])
                            : Sight(state.landmarks[c.landmark[i]], state.stops[c.stop[i]], c.radius_m[i]);
    g.u[i] = sight.d;
    g.d[i] = rows.curve.scale.distance(sight.d);
    g.axis_distance[i] = rows.pairs ? g.d[i] : sight.axis_distance;
    g.bearing[i] = rows.pairs ? rows.bearing_rad[static_cast<std::size_t>(rows.cell_begin[i])]
                              : wrap_angle(sight.bearing);
    g.n[i] = sight.n;
    g.t[i] = sight.t;
    const CurveDerivatives curve = curve_derivatives(state.alpha, rows.curve.scale, g.d[i]);
    g.f[i] = curve.f;
    g.slope[i] = curve.slope;
    g.curvature[i] = curve.curvature;
    g.spread[i] = state.noise.spread(g.d[i], curve.f);
  }
  return g;
}

ReadingView<double> view_of(const Rows& rows, const CellGeometry& g, std::size_t i) {
  const int c = rows.cell[i];
  ReadingView<double> view;
  view.d = g.d[c];
  view.axis_distance = g.axis_distance[c];
  view.bearing = g.bearing[c];
  view.f = g.f[c];
  view.slope = g.slope[c];
  view.curvature = g.curvature[c];
  view.spread = g.spread[c];
  view.spread_power = g.spread_power;
  if (!g.stages.before_light.empty()) {
    view.before_light = g.stages.before_light[c];
    view.before_spot = g.stages.before_spot[c];
  }
  view.radius = rows.radius_m[i];
  view.heading = rows.heading_rad[i];
  view.stop = rows.stop[i];
  view.landmark = rows.landmark[i];
  view.context = &rows.context;
  see_row(rows, i, view);
  return view;
}

void see_row(const Rows& rows, std::size_t i, ReadingView<double>& view) {
  view.time_s = rows.time_s[i];
  view.time = rows.context.duration_s > 0.0 ? rows.time_s[i] / rows.context.duration_s : 0.0;
  view.rate_mps = rows.rate_mps.empty() ? 0.0 : rows.rate_mps[i];
  view.repeat = rows.repeat[i];
  view.covariate =
      rows.context.covariates.empty() ? nullptr : &rows.covariates[i * rows.context.covariates.size()];
}

double distance_step(double d) {
  constexpr double relative = 1e-6, least_m = 0.01;
  return relative * std::max(std::abs(d), least_m);
}

}  // namespace rangecal::diagnosis
