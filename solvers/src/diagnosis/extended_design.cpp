// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/extended_design.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <utility>

#include "diagnosis/draft_design.hpp"
#include "diagnosis/pairs_design.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double soaked_s = 2700.0;  ///< 45 min
constexpr int quarter_turns = 4;     ///< of the sensor at each stop

/// Turned to 0, 90, 180 and 270 degrees at each stop.
void turn_at_each_stop(DraftDesign& draft, const Rows& rows, const JointState& state) {
  const std::size_t columns = rows.context.covariates.size();
  DraftDesign turned = draft;
  turned.priors.clear();
  turned.recording.stops.clear();
  turned.recording.readings = Readings{};
  for (const std::string& name : rows.context.covariates) turned.recording.readings.covariates[name];
  turned.state.stops.clear();
  for (int k = 0; k < rows.problem.stop_count(); ++k)
    for (int i = 0; i < quarter_turns; ++i) {
      StopPrior prior = rows.problem.stops[static_cast<std::size_t>(k)];
      prior.sigma_xy_m = sigma_xy_of(rows.problem, state, k);
      prior.opens_place = prior.opens_place && i == 0;
      prior.commanded.heading_rad = wrap_angle(prior.commanded.heading_rad + i * std::numbers::pi / 2);
      Pose2 pose = state.stops[static_cast<std::size_t>(k)];
      pose.heading_rad = wrap_angle(pose.heading_rad + i * std::numbers::pi / 2);
      turned.add_stop(prior, pose);
    }
  for (std::size_t row = 0; row < rows.size(); ++row)
    for (int i = 0; i < quarter_turns; ++i) {
      const double start = first_time_of_stop(rows, rows.stop[row]);
      turned.add(quarter_turns * rows.stop[row] + i,
                 rows.problem.cells.landmark[static_cast<std::size_t>(rows.cell[row])],
                 rows.time_s[row] + (quarter_turns - 1) * start + i * draft.period_s,
                 rows.covariates.data() + row * columns, rows);
    }
  draft = std::move(turned);
}

/// The distance between the two landmarks farthest apart, by tape.
void tape_the_longest(DraftDesign& draft, const Rows& rows, const JointState& state) {
  const int landmarks = rows.problem.landmark_count();
  KnownDistance tape;
  for (int a = 0; a < landmarks; ++a)
    for (int b = a + 1; b < landmarks; ++b) {
      const double distance =
          (state.landmarks[static_cast<std::size_t>(a)] - state.landmarks[static_cast<std::size_t>(b)])
              .norm();
      if (distance > tape.distance_m) tape = {a, b, distance, 0.002};
    }
  draft.recording.known_distances.push_back(tape);
}

/// The first two landmarks exchanged, and the run repeated.
void exchange_two(DraftDesign& draft, const Rows& rows, const JointState& state,
                  const std::vector<int>& forward, std::vector<int> landmark_of, ExtendedDesign& design) {
  const int landmarks = rows.problem.landmark_count();
  for (int l : {0, 1}) {  // object 0 now stands where 1 stood, and the other way round
    draft.recording.landmarks.push_back(
        {std::to_string(landmarks + l), rows.problem.landmark_radius_m[static_cast<std::size_t>(l)], {}});
    draft.state.landmarks.push_back(state.landmarks[static_cast<std::size_t>(1 - l)]);
    landmark_of[static_cast<std::size_t>(l)] = landmarks + l;
    design.copies[static_cast<std::size_t>(l)].push_back(landmarks + l);
  }
  repeat_all(draft, rows, forward, 0.0, landmark_of);
}

/// 200 sweeps at the stops whose nearest landmark is nearest, middle and farthest.
void sweep_near_middle_far(DraftDesign& draft, const Rows& rows, const JointState& state,
                           std::vector<int> order) {
  std::vector<double> nearest(order.size(), 1e9);
  const std::vector<double> d = cell_geometry(rows, state).d;
  for (std::size_t c = 0; c < d.size(); ++c) {
    double& near = nearest[static_cast<std::size_t>(rows.problem.cells.stop[c])];
    near = std::min(near, d[c]);
  }
  std::sort(order.begin(), order.end(), [&](int a, int b) {
    return nearest[static_cast<std::size_t>(a)] < nearest[static_cast<std::size_t>(b)];
  });
  for (std::size_t at : {std::size_t{0}, order.size() / 2, order.size() - 1})
    more_sweeps(draft, rows, order[at], 200);
}

/// The middle stop moved by 5 mm, five times.
void shift_middle_stop(DraftDesign& draft, const Rows& rows, const JointState& state,
                       const std::vector<int>& landmark_of) {
  const int middle = rows.problem.stop_count() / 2;
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
                      rows.context.duration_s - first_time_of_stop(rows, middle) + j * draft.period_s,
                      landmark_of);
  }
}

/// One more landmark at 0.4 m and one at the far end.
void near_and_far(DraftDesign& draft, const Rows& rows) {
  const Pose2 first = draft.state.stops.front(), middle = draft.state.stops[draft.state.stops.size() / 2];
  const double radius = rows.problem.landmark_radius_m.front();
  const Eigen::Vector2d left(-std::sin(middle.heading_rad), std::cos(middle.heading_rad));
  add_landmark(draft, rows, Eigen::Vector2d(middle.x_m, middle.y_m) + (0.4 + radius) * left, radius);
  add_landmark(draft, rows, Eigen::Vector2d(first.x_m - 4.2, first.y_m - 1.0), radius);
}

}  // namespace

std::vector<MenuEntry> menu_for(const Rows& rows) {
  if (rows.pairs) return menu_for_pairs(rows);
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
  DraftDesign draft(rows, state);
  ExtendedDesign design;
  if (rows.pairs) {
    extend_pairs(rows, code, draft, design);
    return finished(std::move(draft), rows, std::move(design));
  }
  const int stops = rows.problem.stop_count(), landmarks = rows.problem.landmark_count();
  std::vector<int> forward(static_cast<std::size_t>(stops)), same(static_cast<std::size_t>(landmarks));
  for (int k = 0; k < stops; ++k) forward[static_cast<std::size_t>(k)] = k;
  for (int l = 0; l < landmarks; ++l) {
    same[static_cast<std::size_t>(l)] = l;
    design.copies.push_back({l});
  }
  if (code == "E1") {
    turn_at_each_stop(draft, rows, state);
    design.stop_factor = quarter_turns;
  } else if (code == "E2") {
    repeat_all(draft, rows, {forward.rbegin(), forward.rend()}, 0.0, same);
  } else if (code == "E3") {
    tape_the_longest(draft, rows, state);
  } else if (code == "E4") {
    constexpr double radii[] = {0.04, 0.12, 0.08};
    for (int l = 0; l < landmarks; ++l)
      draft.recording.landmarks[static_cast<std::size_t>(l)].radius_m = radii[l % 3];
  } else if (code == "E6") {
    exchange_two(draft, rows, state, forward, same, design);
  } else if (code == "E7") {
    sweep_near_middle_far(draft, rows, state, forward);
  } else if (code == "E8") {
    shift_middle_stop(draft, rows, state, same);
  } else if (code == "E9") {
    near_and_far(draft, rows);
  } else if (code == "E10" || code == "E11") {
    design.switched_off = effects_without(code);
    design.first_new_stop = repeat_all(draft, rows, forward, 0.0, same);
  } else if (code == "E12") {
    repeat_all(draft, rows, {0}, soaked_s, same);
  } else {
    throw std::invalid_argument("no experiment is called '" + code + "'");
  }
  return finished(std::move(draft), rows, std::move(design));
}

std::set<std::string> effects_without(const std::string& code) {
  std::set<std::string> ids;
  for (const Effect* effect : known_effects()) {
    const std::vector<std::string>& codes = effect->info().switched_off_by;
    if (std::find(codes.begin(), codes.end(), code) != codes.end()) ids.insert(effect->info().id);
  }
  return ids;
}

Model in_design(const ExtendedDesign& design, const Model& model) {
  Model result;
  for (ActiveEffect active : model) {
    const EffectInfo& info = active.effect->info();
    if (info.kind == EffectKind::grid && design.switched_off.count(info.id)) continue;
    std::vector<int> indices;
    Eigen::Index landmark = -1;
    for (Eigen::Index j = 0; j < active.parameters.size(); ++j) {
      const EffectParameter& parameter = info.parameters[static_cast<std::size_t>(j)];
      if (parameter.discrete && parameter.name.find("stop") != std::string::npos)
        active.parameters[j] *= design.stop_factor;
      if (parameter.discrete && parameter.name == "landmark") landmark = j;
    }
    if (info.over_the_recording) active.parameters *= design.drift_factor;
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
