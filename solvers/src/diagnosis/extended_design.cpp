// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/extended_design.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "rangecal/core/angles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double soaked_s = 2700.0;  ///< 45 min

/// The recording and the estimate, stop by stop, in a form that is easily lengthened.
struct Draft {
  Recording recording;
  std::vector<StopPrior>
      priors;  ///< of every stop: recording and chain, which a Recording cannot say per stop
  JointState state;
  double period_s = 0.0;  ///< from stop to stop

  Draft(const Rows& rows, const JointState& at) : state(at) {
    recording.kind = rows.pairs ? RecordingKind::pairs : RecordingKind::landmarks;
    priors = rows.problem.stops;
    for (std::size_t k = 0; k < priors.size(); ++k)
      add_stop_record(priors[k], sigma_xy_of(rows.problem, at, static_cast<int>(k)));
    for (int l = 0; l < (rows.pairs ? 1 : rows.problem.landmark_count()); ++l)
      recording.landmarks.push_back(
          {std::to_string(l),
           rows.pairs ? 0.0 : rows.problem.landmark_radius_m[static_cast<std::size_t>(l)],
           {}});
    recording.known_distances = rows.problem.known_distances;
    const std::size_t columns = rows.context.covariates.size();
    for (const std::string& name : rows.context.covariates) recording.readings.covariates[name];
    for (std::size_t i = 0; i < rows.size(); ++i)
      add(rows.stop[i], rows.problem.cells.landmark[static_cast<std::size_t>(rows.cell[i])], rows.time_s[i],
          rows.covariates.data() + i * columns, rows);
    period_s = rows.context.duration_s / std::max(1, rows.pairs ? 25 : rows.problem.stop_count());
  }

  void add_stop_record(const StopPrior& prior, double sigma_xy) {
    Stop stop;
    stop.label = std::to_string(recording.stops.size());
    stop.commanded = prior.commanded;
    stop.sigma_xy_m = sigma_xy;
    stop.sigma_heading_rad = prior.sigma_heading_rad;
    stop.place = std::to_string(prior.place);
    recording.stops.push_back(stop);
  }

  /// A reading as the estimate predicts it.
  void add(int stop, int landmark, double time_s, const double* covariates, const Rows& rows) {
    Readings& r = recording.readings;
    r.stop.push_back(stop);
    r.landmark.push_back(landmark);
    r.repeat.push_back(0);
    r.time_s.push_back(time_s);
    r.range_m.push_back(1.0);
    r.bearing_rad.push_back(0.0);
    std::size_t column = 0;
    for (const std::string& name : rows.context.covariates)
      r.covariates[name].push_back(covariates[column++]);
  }

  int add_stop(const StopPrior& prior, const Pose2& pose) {
    priors.push_back(prior);
    add_stop_record(prior, prior.sigma_xy_m);
    state.stops.push_back(pose);
    return static_cast<int>(priors.size()) - 1;
  }

  int new_place() const {
    int last = 0;
    for (const StopPrior& prior : priors) last = std::max(last, prior.place);
    return last + 1;
  }

  /// Once more the readings of stop k from another stop, `shift_s` later.
  void repeat_stop(const Rows& rows, int k, int at_stop, double shift_s,
                   const std::vector<int>& landmark_of) {
    const std::size_t columns = rows.context.covariates.size();
    for (std::size_t i = 0; i < rows.size(); ++i)
      if (rows.stop[i] == k)
        add(at_stop,
            landmark_of[static_cast<std::size_t>(
                rows.problem.cells.landmark[static_cast<std::size_t>(rows.cell[i])])],
            rows.time_s[i] + shift_s, rows.covariates.data() + i * columns, rows);
  }
};

double first_time(const Rows& rows, int stop) {
  return rows.context.stop_time_s.empty() ? 0.0 : rows.context.stop_time_s[static_cast<std::size_t>(stop)];
}

/// All stops once more in the given order, driven to anew.
int repeat_all(Draft& draft, const Rows& rows, const std::vector<int>& order, double pause_s,
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
    draft.repeat_stop(rows, k, at, clock - first_time(rows, k), landmark_of);
  }
  return first;
}

/// Readings of more repeats at a stop, spread over as much time as the first ones take each.
void more_sweeps(Draft& draft, const Rows& rows, int k, int sweeps) {
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

/// A new landmark seen from every stop as often as the others.
void add_landmark(Draft& draft, const Rows& rows, const Eigen::Vector2d& at, double radius) {
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

void near_and_far(Draft& draft, const Rows& rows) {
  const Pose2 first = draft.state.stops.front(), middle = draft.state.stops[draft.state.stops.size() / 2];
  const double radius = rows.problem.landmark_radius_m.front();
  const Eigen::Vector2d left(-std::sin(middle.heading_rad), std::cos(middle.heading_rad));
  add_landmark(draft, rows, Eigen::Vector2d(middle.x_m, middle.y_m) + (0.4 + radius) * left, radius);
  add_landmark(draft, rows, Eigen::Vector2d(first.x_m - 4.2, first.y_m - 1.0), radius);
}

void turn_at_each_stop(Draft& draft, const Rows& rows, const JointState& state) {
  constexpr int turns = 4;
  const std::size_t columns = rows.context.covariates.size();
  Draft turned = draft;
  turned.priors.clear();
  turned.recording.stops.clear();
  turned.recording.readings = Readings{};
  for (const std::string& name : rows.context.covariates) turned.recording.readings.covariates[name];
  turned.state.stops.clear();
  for (int k = 0; k < rows.problem.stop_count(); ++k)
    for (int i = 0; i < turns; ++i) {
      StopPrior prior = rows.problem.stops[static_cast<std::size_t>(k)];
      prior.sigma_xy_m = sigma_xy_of(rows.problem, state, k);
      prior.opens_place = prior.opens_place && i == 0;
      prior.commanded.heading_rad = wrap_angle(prior.commanded.heading_rad + i * std::numbers::pi / 2);
      Pose2 pose = state.stops[static_cast<std::size_t>(k)];
      pose.heading_rad = wrap_angle(pose.heading_rad + i * std::numbers::pi / 2);
      turned.add_stop(prior, pose);
    }
  for (std::size_t row = 0; row < rows.size(); ++row)
    for (int i = 0; i < turns; ++i) {
      const double start = first_time(rows, rows.stop[row]);
      turned.add(turns * rows.stop[row] + i,
                 rows.problem.cells.landmark[static_cast<std::size_t>(rows.cell[row])],
                 rows.time_s[row] + (turns - 1) * start + i * draft.period_s,
                 rows.covariates.data() + row * columns, rows);
    }
  draft = std::move(turned);
}

ExtendedDesign finish(Draft draft, const Rows& rows, ExtendedDesign design) {
  Recording& recording = draft.recording;
  recording.stop_error = StopErrorModel::independent;
  design.rows = make_rows({&recording, 1});
  Rows& extended = design.rows;
  for (std::size_t k = 0; k < draft.priors.size(); ++k) {
    extended.problem.stops[k].recording = draft.priors[k].recording;
    extended.problem.stops[k].chained = draft.priors[k].chained;
    extended.problem.stops[k].turns_add_up = draft.priors[k].turns_add_up;
    if (draft.priors[k].opens_place) extended.problem.stops[k].shape = draft.priors[k].shape;
  }
  extended.context.range_min_m = rows.context.range_min_m;
  extended.context.range_max_m = rows.context.range_max_m;
  if (rows.context.duration_s > 0.0 && extended.context.duration_s > 0.0)
    design.drift_factor = extended.context.duration_s / rows.context.duration_s;
  else
    extended.context.duration_s = 0.0, extended.context.stop_time_s.clear();
  design.state = std::move(draft.state);
  const CellGeometry geometry = cell_geometry(extended, design.state);
  for (std::size_t i = 0; i < extended.size();
       ++i) {  // as predicted: weights that depend on residuals see none
    extended.range_m[i] = geometry.f[static_cast<std::size_t>(extended.cell[i])];
    extended.bearing_rad[i] = geometry.bearing[static_cast<std::size_t>(extended.cell[i])];
  }
  return design;
}

}  // namespace

std::vector<MenuEntry> menu_for(const Rows& rows) {
  if (rows.pairs) return {};
  std::vector<MenuEntry> menu{{"E1", "turn the sensor to 0, 90, 180, 270 degrees at each stop"},
                              {"E2", "drive the same stops once more in reverse order"},
                              {"E3", "tape the distance between two landmarks"},
                              {"E4", "use landmarks of two or more radii (4, 8 and 12 cm)"},
                              {"E7", "record 200 sweeps at one near, one middle and one far stop"},
                              {"E8", "move one stop by 5 mm, five times"},
                              {"E9", "place one more landmark at 0.4 m and one at the far end"},
                              {"E10", "repeat the run with the lights off or the window covered"},
                              {"E11", "repeat the run, waiting longer before each reading"}};
  if (rows.problem.landmark_count() >= 2)
    menu.insert(menu.begin() + 4, {"E6", "exchange two landmarks and repeat the run"});
  if (rows.context.duration_s > 0.0)
    menu.push_back({"E12", "leave the sensor on for 45 minutes, then repeat the first stop"});
  return menu;
}

ExtendedDesign extend(const Rows& rows, const JointState& state, const std::string& code) {
  Draft draft(rows, state);
  ExtendedDesign design;
  const int stops = rows.problem.stop_count(), landmarks = rows.problem.landmark_count();
  std::vector<int> forward(static_cast<std::size_t>(stops)), same(static_cast<std::size_t>(landmarks));
  for (int k = 0; k < stops; ++k) forward[static_cast<std::size_t>(k)] = k;
  for (int l = 0; l < landmarks; ++l) {
    same[static_cast<std::size_t>(l)] = l;
    design.copies.push_back({l});
  }
  if (code == "E1") {
    turn_at_each_stop(draft, rows, state);
    design.stop_factor = 4;
  } else if (code == "E2") {
    repeat_all(draft, rows, {forward.rbegin(), forward.rend()}, 0.0, same);
  } else if (code == "E3") {
    KnownDistance tape;
    for (int a = 0; a < landmarks; ++a)
      for (int b = a + 1; b < landmarks; ++b) {
        const double distance =
            (state.landmarks[static_cast<std::size_t>(a)] - state.landmarks[static_cast<std::size_t>(b)])
                .norm();
        if (distance > tape.distance_m) tape = {a, b, distance, 0.002};
      }
    draft.recording.known_distances.push_back(tape);
  } else if (code == "E4") {
    constexpr double radii[] = {0.04, 0.12, 0.08};
    for (int l = 0; l < landmarks; ++l)
      draft.recording.landmarks[static_cast<std::size_t>(l)].radius_m = radii[l % 3];
  } else if (code == "E6") {
    std::vector<int> exchanged = same;  // object 0 now stands where 1 stood, and the other way round
    for (int l : {0, 1}) {
      draft.recording.landmarks.push_back(
          {std::to_string(landmarks + l), rows.problem.landmark_radius_m[static_cast<std::size_t>(l)], {}});
      draft.state.landmarks.push_back(state.landmarks[static_cast<std::size_t>(1 - l)]);
      exchanged[static_cast<std::size_t>(l)] = landmarks + l;
      design.copies[static_cast<std::size_t>(l)].push_back(landmarks + l);
    }
    repeat_all(draft, rows, forward, 0.0, exchanged);
  } else if (code == "E7") {
    std::vector<double> nearest(static_cast<std::size_t>(stops), 1e9);
    const std::vector<double> d = cell_geometry(rows, state).d;
    for (std::size_t c = 0; c < d.size(); ++c) {
      double& near = nearest[static_cast<std::size_t>(rows.problem.cells.stop[c])];
      near = std::min(near, d[c]);
    }
    std::vector<int> order = forward;
    std::sort(order.begin(), order.end(), [&](int a, int b) {
      return nearest[static_cast<std::size_t>(a)] < nearest[static_cast<std::size_t>(b)];
    });
    for (std::size_t at : {std::size_t{0}, order.size() / 2, order.size() - 1})
      more_sweeps(draft, rows, order[at], 200);
  } else if (code == "E8") {
    const int middle = stops / 2;
    for (int j = 1; j <= 5; ++j) {
      StopPrior prior = rows.problem.stops[static_cast<std::size_t>(middle)];
      Pose2 pose = state.stops[static_cast<std::size_t>(middle)];
      const double x = 0.005 * j * std::cos(pose.heading_rad), y = 0.005 * j * std::sin(pose.heading_rad);
      prior.commanded.x_m += x, pose.x_m += x;
      prior.commanded.y_m += y, pose.y_m += y;
      prior.place = draft.new_place();
      prior.opens_place = true;
      const int at = draft.add_stop(prior, pose);
      draft.repeat_stop(rows, middle, at,
                        rows.context.duration_s - first_time(rows, middle) + j * draft.period_s, same);
    }
  } else if (code == "E9") {
    near_and_far(draft, rows);
  } else if (code == "E10" || code == "E11") {
    design.switched_off = code == "E10" ? std::set<std::string>{"ambient_light"}
                                        : std::set<std::string>{"settling", "sweep_motion"};
    design.first_new_stop = repeat_all(draft, rows, forward, 0.0, same);
  } else if (code == "E12") {
    repeat_all(draft, rows, {0}, soaked_s, same);
  } else {
    throw std::invalid_argument("no experiment is called '" + code + "'");
  }
  return finish(std::move(draft), rows, std::move(design));
}

Model in_design(const ExtendedDesign& design, const Model& model) {
  Model result;
  for (ActiveEffect active : model) {
    const EffectInfo& info = active.effect->info();
    std::vector<int> indices;
    Eigen::Index landmark = -1;
    for (Eigen::Index j = 0; j < active.parameters.size(); ++j) {
      const EffectParameter& parameter = info.parameters[static_cast<std::size_t>(j)];
      if (parameter.discrete && parameter.name.find("stop") != std::string::npos)
        active.parameters[j] *= design.stop_factor;
      if (parameter.discrete && parameter.name == "landmark") landmark = j;
    }
    if (info.id == "bearing_drift" || info.id == "heading_drift") active.parameters *= design.drift_factor;
    if (landmark >= 0) {
      const auto l = static_cast<std::size_t>(std::lround(active.parameters[landmark]));
      if (l < design.copies.size()) indices = design.copies[l];
    }
    if (indices.empty()) {
      result.push_back(active);
      continue;
    }
    for (int index : indices) {
      active.parameters[landmark] = index;
      result.push_back(active);
    }
  }
  return result;
}

}  // namespace rangecal::diagnosis
