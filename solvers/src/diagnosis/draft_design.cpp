// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/draft_design.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

namespace rangecal::diagnosis {

DraftDesign::DraftDesign(const Rows& rows, const JointState& at) : state(at) {
  recording.kind = rows.context.kind;
  recording.known_distances = rows.problem.known_distances;
  Covariates& covariates = covariates_of(recording);
  const std::size_t columns = rows.context.covariates.size();
  for (std::size_t c = 0; c < columns; ++c) {
    covariates[rows.context.covariates[c]];
    recording.columns[rows.context.covariates[c]].role = rows.context.columns[c].role;
  }
  if (rows.pairs) {
    for (std::size_t l = 0; l < rows.context.landmark_labels.size(); ++l)
      recording.landmarks.push_back({rows.context.landmark_labels[l], rows.context.landmark_radius_m[l], {}});
    const std::vector<double> d = cell_geometry(rows, at).d;
    for (std::size_t i = 0; i < rows.size(); ++i)
      add_pair(rows.cell[i],
               {d[static_cast<std::size_t>(rows.cell[i])], rows.landmark[i], rows.bearing_rad[i]},
               rows.time_s[i], rows.covariates.data() + i * columns, rows);
    batches = rows.cell_count;
    const double steps = std::max(1.0, static_cast<double>(rows.size()) - 1.0);
    period_s = rows.context.duration_s > 0.0 ? rows.context.duration_s / steps : 1.0;
    return;
  }
  priors = rows.problem.stops;
  for (std::size_t k = 0; k < priors.size(); ++k)
    add_stop_record(priors[k], sigma_xy_of(rows.problem, at, static_cast<int>(k)));
  for (int l = 0; l < rows.problem.landmark_count(); ++l)
    recording.landmarks.push_back(
        {std::to_string(l), rows.problem.landmark_radius_m[static_cast<std::size_t>(l)], {}});
  for (std::size_t i = 0; i < rows.size(); ++i)
    add(rows.stop[i], rows.problem.cells.landmark[static_cast<std::size_t>(rows.cell[i])], rows.time_s[i],
        rows.covariates.data() + i * columns, rows);
  period_s = rows.context.duration_s / std::max(1, rows.problem.stop_count());
}

void DraftDesign::add_pair(int batch, const PairAt& at, double time_s, const double* covariates,
                           const Rows& rows) {
  Pairs& p = recording.pairs;
  p.batch.push_back(batch);
  p.true_m.push_back(at.true_m);
  p.landmark.push_back(at.landmark);
  p.bearing_rad.push_back(at.bearing_rad);
  p.time_s.push_back(time_s);
  p.reading_m.push_back(1.0);
  std::size_t column = 0;
  for (const std::string& name : rows.context.covariates) p.covariates[name].push_back(covariates[column++]);
}

void DraftDesign::add_stop_record(const StopPrior& prior, double sigma_xy) {
  Stop stop;
  stop.label = std::to_string(recording.stops.size());
  stop.commanded = prior.commanded;
  stop.sigma_xy_m = sigma_xy;
  stop.sigma_heading_rad = prior.sigma_heading_rad;
  stop.place = std::to_string(prior.place);
  recording.stops.push_back(stop);
}

void DraftDesign::add(int stop, int landmark, double time_s, const double* covariates, const Rows& rows) {
  Readings& r = recording.readings;
  r.stop.push_back(stop);
  r.landmark.push_back(landmark);
  r.repeat.push_back(0);
  r.time_s.push_back(time_s);
  r.range_m.push_back(1.0);
  if (rows.problem.reads_bearings) r.bearing_rad.push_back(0.0);
  std::size_t column = 0;
  for (const std::string& name : rows.context.covariates) r.covariates[name].push_back(covariates[column++]);
}

int DraftDesign::add_stop(const StopPrior& prior, const Pose2& pose) {
  priors.push_back(prior);
  add_stop_record(prior, prior.sigma_xy_m);
  state.stops.push_back(pose);
  return static_cast<int>(priors.size()) - 1;
}

int DraftDesign::new_place() const {
  int last = 0;
  for (const StopPrior& prior : priors) last = std::max(last, prior.place);
  return last + 1;
}

void DraftDesign::repeat_stop(const Rows& rows, int k, int at_stop, double shift_s,
                              const std::vector<int>& landmark_of) {
  const std::size_t columns = rows.context.covariates.size();
  for (std::size_t i = 0; i < rows.size(); ++i)
    if (rows.stop[i] == k)
      add(at_stop,
          landmark_of[static_cast<std::size_t>(
              rows.problem.cells.landmark[static_cast<std::size_t>(rows.cell[i])])],
          rows.time_s[i] + shift_s, rows.covariates.data() + i * columns, rows);
}

double first_time_of_stop(const Rows& rows, int stop) {
  return rows.context.stop_time_s.empty() ? 0.0 : rows.context.stop_time_s[static_cast<std::size_t>(stop)];
}

int repeat_all(DraftDesign& draft, const Rows& rows, const std::vector<int>& order, double pause_s,
               const std::vector<int>& landmark_of) {
  const double end = rows.context.duration_s + pause_s;
  double clock = end;
  int first = -1;
  std::vector<std::pair<int, int>> places;  // old, new
  for (int k : order) {
    StopPrior prior = rows.problem.stops[static_cast<std::size_t>(k)];
    const auto known =
        std::find_if(places.begin(), places.end(), [&](const auto& p) { return p.first == prior.place; });
    prior.opens_place = known == places.end();
    if (prior.opens_place) places.emplace_back(prior.place, draft.new_place());
    prior.place = prior.opens_place ? places.back().second : known->second;
    const int at = draft.add_stop(prior, draft.state.stops[static_cast<std::size_t>(k)]);
    if (first < 0) first = at;
    clock += draft.period_s;
    draft.repeat_stop(rows, k, at, clock - first_time_of_stop(rows, k), landmark_of);
  }
  return first;
}

void more_sweeps(DraftDesign& draft, const Rows& rows, int k, int sweeps) {
  const std::size_t columns = rows.context.covariates.size();
  const Cells& c = rows.problem.cells;
  for (int cell = c.stop_begin[static_cast<std::size_t>(k)];
       cell < c.stop_begin[static_cast<std::size_t>(k) + 1]; ++cell) {
    const int first = rows.cell_begin[cell], last = rows.cell_begin[cell + 1] - 1;
    const double step =
        last > first
            ? (rows.time_s[static_cast<std::size_t>(last)] - rows.time_s[static_cast<std::size_t>(first)]) /
                  (last - first)
            : 0.0;
    for (int j = last - first + 1; j < sweeps; ++j)
      draft.add(k, c.landmark[static_cast<std::size_t>(cell)],
                rows.time_s[static_cast<std::size_t>(first)] + j * step,
                rows.covariates.data() + static_cast<std::size_t>(first) * columns, rows);
  }
}

void add_landmark(DraftDesign& draft, const Rows& rows, const Eigen::Vector2d& at, double radius) {
  draft.recording.landmarks.push_back({std::to_string(draft.recording.landmarks.size()), radius, {}});
  draft.state.landmarks.push_back(at);
  const int landmark = static_cast<int>(draft.recording.landmarks.size()) - 1;
  const std::size_t columns = rows.context.covariates.size();
  const Cells& c = rows.problem.cells;
  for (int k = 0; k < rows.problem.stop_count(); ++k) {
    if (c.stop_begin[static_cast<std::size_t>(k)] == c.stop_begin[static_cast<std::size_t>(k) + 1]) continue;
    const Pose2& pose = draft.state.stops[static_cast<std::size_t>(k)];
    if (std::hypot(at.x() - pose.x_m, at.y() - pose.y_m) < radius + 0.1) continue;
    const int cell = c.stop_begin[static_cast<std::size_t>(k)];
    for (int i = rows.cell_begin[cell]; i < rows.cell_begin[cell + 1]; ++i)
      draft.add(k, landmark, rows.time_s[static_cast<std::size_t>(i)],
                rows.covariates.data() + static_cast<std::size_t>(i) * columns, rows);
  }
}

ExtendedDesign finished(DraftDesign draft, const Rows& rows, ExtendedDesign design) {
  Recording& recording = draft.recording;
  recording.stop_error = StopErrorModel::independent;
  design.rows = make_rows({&recording, 1}, rows.curve);
  Rows& extended = design.rows;
  if (rows.pairs) {  // every cell has an exact stop of its own
    draft.state.stops.clear();
    for (const StopPrior& prior : extended.problem.stops) draft.state.stops.push_back(prior.commanded);
  }
  for (std::size_t k = 0; k < draft.priors.size(); ++k) {
    extended.problem.stops[k].recording = draft.priors[k].recording;
    extended.problem.stops[k].chained = draft.priors[k].chained;
    extended.problem.stops[k].turns_add_up = draft.priors[k].turns_add_up;
    if (draft.priors[k].opens_place) extended.problem.stops[k].shape = draft.priors[k].shape;
  }
  extended.alpha_prior = rows.alpha_prior;
  extended.context.range_min_m = rows.context.range_min_m;
  extended.context.range_max_m = rows.context.range_max_m;
  if (rows.context.duration_s > 0.0 && extended.context.duration_s > 0.0)
    design.drift_factor = extended.context.duration_s / rows.context.duration_s;
  else if (!design.adds_times)
    extended.context.duration_s = 0.0, extended.context.stop_time_s.clear();
  design.state = std::move(draft.state);
  const CellGeometry geometry = cell_geometry(extended, design.state);
  for (std::size_t i = 0; i < extended.size(); ++i) {  // weights that depend on residuals see none
    extended.range_m[i] = geometry.f[static_cast<std::size_t>(extended.cell[i])];
    extended.bearing_rad[i] = geometry.bearing[static_cast<std::size_t>(extended.cell[i])];
  }
  return design;
}

}  // namespace rangecal::diagnosis
