// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/labels.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/without_readings.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

/// "2, 5, 7", of many the first ones: "2, 5, 7, ...".
std::string stop_labels(const Recording& recording, const std::vector<int>& stops) {
  constexpr std::size_t most = 12;
  std::string text;
  for (std::size_t i = 0; i < std::min(stops.size(), most); ++i)
    text += (text.empty() ? "" : ", ") + recording.stops[static_cast<std::size_t>(stops[i])].label;
  return stops.size() > most ? text + ", ..." : text;
}

/// Where the readings put the landmarks, the stops where they were commanded.
struct Map {
  std::vector<Eigen::Vector2d> at;  ///< every reading
  std::vector<Eigen::Vector2d>
      centre;            ///< every landmark, by medians; far away of one that is seen fewer than three times
  double usual_m = 0.0;  ///< distance of a reading from its landmark
};

constexpr double nowhere_m = 1e9;

Map map_of(const Recording& recording) {
  const Readings& r = recording.readings;
  const std::size_t landmarks = recording.landmarks.size();
  Map map{std::vector<Eigen::Vector2d>(r.size()),
          std::vector<Eigen::Vector2d>(landmarks, Eigen::Vector2d::Constant(nowhere_m))};
  std::vector<std::vector<double>> xs(landmarks), ys(landmarks);
  for (std::size_t i = 0; i < r.size(); ++i) {
    const auto l = static_cast<std::size_t>(r.landmark[i]);
    const Pose2& pose = recording.stops[static_cast<std::size_t>(r.stop[i])].commanded;
    const double reach = r.range_m[i] + recording.landmarks[l].radius_m;
    const double direction = pose.heading_rad + r.bearing_rad[i];
    map.at[i] = {pose.x_m + reach * std::cos(direction), pose.y_m + reach * std::sin(direction)};
    xs[l].push_back(map.at[i].x());
    ys[l].push_back(map.at[i].y());
  }
  for (std::size_t l = 0; l < landmarks; ++l)
    if (xs[l].size() > 2) map.centre[l] = {upper_median(xs[l]), upper_median(ys[l])};
  std::vector<double> scatter;
  for (std::size_t i = 0; i < r.size(); ++i)
    scatter.push_back((map.at[i] - map.centre[static_cast<std::size_t>(r.landmark[i])]).norm());
  map.usual_m = std::max(0.05, upper_median(std::move(scatter)));
  return map;
}

void correct_labels(Recording& recording, Bookkeeping& found) {
  Readings& r = recording.readings;
  if (r.size() == 0) return;
  const int landmarks = static_cast<int>(recording.landmarks.size());
  const Map map = map_of(recording);

  // Mean position of each cell.
  std::map<std::pair<int, int>, std::pair<Eigen::Vector2d, int>> cells;
  for (std::size_t i = 0; i < r.size(); ++i) {
    auto& [sum, count] =
        cells.try_emplace({r.stop[i], r.landmark[i]}, Eigen::Vector2d::Zero(), 0).first->second;
    sum += map.at[i];
    ++count;
  }
  const auto misplaced = [&](int stop, int own, int other) {
    const auto cell = cells.find({stop, own});
    if (cell == cells.end()) return false;
    const Eigen::Vector2d mean = cell->second.first / cell->second.second;
    const double away = (mean - map.centre[own]).norm(), near = (mean - map.centre[other]).norm();
    return away > 5.0 * map.usual_m && near < away / 3.0;
  };
  std::map<std::pair<int, int>, std::vector<int>> swaps;
  for (int k = 0; k < static_cast<int>(recording.stops.size()); ++k)
    for (int a = 0; a < landmarks; ++a)
      for (int b = a + 1; b < landmarks; ++b)
        if (misplaced(k, a, b) && misplaced(k, b, a)) swaps[{a, b}].push_back(k);
  for (const auto& [pair, stops] : swaps) {
    for (std::size_t i = 0; i < r.size(); ++i) {
      if (std::find(stops.begin(), stops.end(), r.stop[i]) == stops.end()) continue;
      if (r.landmark[i] == pair.first)
        r.landmark[i] = pair.second;
      else if (r.landmark[i] == pair.second)
        r.landmark[i] = pair.first;
    }
    const Effect* effect = find_effect("label_swap");
    Eigen::VectorXd p(4);
    p << pair.first, pair.second, stops.front(), stops.back();
    found.model.push_back({effect, p});
    Question q = bookkeeping_question("label", "landmark", "one group", certain);
    q.from = stops.front();
    q.to = stops.back();
    q.group = recording.landmarks[pair.first].label + ", " + recording.landmarks[pair.second].label;
    found.findings.push_back(q);
    found.notes.push_back(
        fmt::format("the labels {} were exchanged at {} stop(s), {}; they were put back before fitting",
                    q.group, stops.size(), stop_labels(recording, stops)));
  }
}

/// Distance of every landmark from the one next to it; infinite of a single one.
std::vector<double> spacings(const std::vector<Eigen::Vector2d>& centre) {
  std::vector<double> nearest(centre.size(), std::numeric_limits<double>::infinity());
  for (std::size_t a = 0; a < centre.size(); ++a)
    for (std::size_t b = 0; b < centre.size(); ++b)
      if (a != b) nearest[a] = std::min(nearest[a], (centre[a] - centre[b]).norm());
  return nearest;
}

/// By reading: how far it is turned from where its landmark is, and the same across [m].
struct Turns {
  std::vector<double> angle_rad, across_m;
};

/// How far a stop itself is turned, by what its readings are: their median; of two landmarks what the one has that is turned less, so that both
/// have to be; of a single one nothing, which cannot tell. `least`: the smallest of each landmark.
double own_turn(const std::map<int, double>& least, std::vector<double> angles) {
  if (least.size() < 2) return 0.0;
  if (least.size() > 2) return upper_median(std::move(angles));
  const double a = least.begin()->second, b = least.rbegin()->second;
  return std::abs(a) < std::abs(b) ? a : b;
}

/// Less what the stop itself is turned by.
Turns turns_of(const Recording& recording, const Map& map) {
  const Readings& r = recording.readings;
  Turns turns{std::vector<double>(r.size(), 0.0), std::vector<double>(r.size(), 0.0)};
  std::vector<std::vector<std::size_t>> of_stop(recording.stops.size());
  std::vector<double> distance(r.size(), 0.0);
  for (std::size_t i = 0; i < r.size(); ++i) {
    const Eigen::Vector2d& centre = map.centre[static_cast<std::size_t>(r.landmark[i])];
    if (centre.x() == nowhere_m) continue;
    const auto stop = static_cast<std::size_t>(r.stop[i]);
    const Pose2& pose = recording.stops[stop].commanded;
    const Eigen::Vector2d v(centre.x() - pose.x_m, centre.y() - pose.y_m);
    turns.angle_rad[i] = wrap_angle(pose.heading_rad + r.bearing_rad[i] - std::atan2(v.y(), v.x()));
    distance[i] = v.norm();
    of_stop[stop].push_back(i);
  }
  for (const std::vector<std::size_t>& readings : of_stop) {
    std::map<int, double> least;  // of a landmark, in size
    std::vector<double> angles;
    for (const std::size_t i : readings) {
      const double angle = turns.angle_rad[i];
      double& of_landmark = least.try_emplace(r.landmark[i], angle).first->second;
      if (std::abs(angle) < std::abs(of_landmark)) of_landmark = angle;
      angles.push_back(angle);
    }
    const double own = own_turn(least, std::move(angles));
    for (const std::size_t i : readings) {
      turns.angle_rad[i] = wrap_angle(turns.angle_rad[i] - own);
      turns.across_m[i] = distance[i] * 2.0 * std::sin(0.5 * std::abs(turns.angle_rad[i]));
    }
  }
  return turns;
}

/// True if the landmark is where it belongs at no stop after the first of these, or at none before the last, and they are several.
bool was_moved(const Readings& readings, const std::vector<const MisreadLabel*>& of_landmark,
               const std::set<std::size_t>& misread) {
  if (of_landmark.size() < 2) return false;
  bool before = false, after = false;
  for (std::size_t i = 0; i < readings.size(); ++i) {
    if (readings.landmark[i] != of_landmark.front()->landmark || misread.count(i) > 0) continue;
    before = before || readings.stop[i] < of_landmark.back()->stop;
    after = after || readings.stop[i] > of_landmark.front()->stop;
  }
  return !before || !after;
}

}  // namespace

Bookkeeping correct_labels(std::vector<Recording>& recordings) {
  Bookkeeping found;
  for (Recording& recording : recordings)
    if (recording.kind == RecordingKind::landmarks && recording.readings.has_bearings())
      correct_labels(recording, found);
  return found;
}

std::vector<MisreadLabel> misread_labels(const Recording& recorded) {
  constexpr double far = 12.0;  // robust standard deviations
  constexpr double part_of_spacing = 0.8, most_of_cells = 0.02;
  if (recorded.kind != RecordingKind::landmarks || recorded.readings.size() == 0 ||
      !recorded.readings.has_bearings())
    return {};
  Recording recording = recorded;
  Bookkeeping unused;
  correct_labels(recording, unused);
  const Readings& r = recording.readings;
  const Map map = map_of(recording);
  const Turns turns = turns_of(recording, map);
  const double spread_rad = robust_spread(turns.angle_rad), spread_m = robust_spread(turns.across_m);
  const std::vector<double> spacing = spacings(map.centre);
  std::map<std::pair<int, int>, MisreadLabel> cells;  // by landmark and stop
  std::set<std::pair<int, int>> all;
  std::set<std::size_t> readings;
  for (std::size_t i = 0; i < r.size(); ++i) {
    all.insert({r.landmark[i], r.stop[i]});
    if (!(std::abs(turns.angle_rad[i]) > far * spread_rad &&
          turns.across_m[i] >
              std::max(far * spread_m, part_of_spacing * spacing[static_cast<std::size_t>(r.landmark[i])])))
      continue;
    MisreadLabel& cell = cells[{r.landmark[i], r.stop[i]}];
    if (cell.readings.empty()) {
      cell.stop = r.stop[i];
      cell.landmark = r.landmark[i];
      cell.turned_rad = turns.angle_rad[i];
      for (std::size_t l = 0; l < map.centre.size(); ++l)
        if (static_cast<int>(l) != cell.landmark && (map.at[i] - map.centre[l]).norm() < 3.0 * map.usual_m)
          cell.seen = static_cast<int>(l);
    }
    cell.readings.push_back(i);
    readings.insert(i);
  }
  if (static_cast<double>(cells.size()) > std::max(1.0, most_of_cells * static_cast<double>(all.size())))
    return {};
  std::map<int, std::vector<const MisreadLabel*>> of_landmarks;
  for (const auto& [key, cell] : cells) of_landmarks[cell.landmark].push_back(&cell);
  std::vector<MisreadLabel> misread;
  for (const auto& [landmark, of_landmark] : of_landmarks)
    if (!was_moved(r, of_landmark, readings))
      for (const MisreadLabel* cell : of_landmark) misread.push_back(*cell);
  return misread;
}

std::string in_words(const std::vector<MisreadLabel>& misread, const Recording& recording) {
  constexpr std::size_t most = 4;
  std::vector<std::string> parts;
  for (std::size_t i = 0; i < std::min(most, misread.size()); ++i) {
    const MisreadLabel& m = misread[i];
    parts.push_back(fmt::format("{} at stop {}, turned by {:.0f} deg",
                                recording.landmarks[static_cast<std::size_t>(m.landmark)].label,
                                recording.stops[static_cast<std::size_t>(m.stop)].label,
                                m.turned_rad * 180.0 / std::numbers::pi));
    if (m.seen >= 0)
      parts.back() +=
          fmt::format(", where {} stands", recording.landmarks[static_cast<std::size_t>(m.seen)].label);
  }
  if (misread.size() > most) parts.push_back(fmt::format("and {} more", misread.size() - most));
  return fmt::format("{}", fmt::join(parts, "; "));
}

Recording without_misread(const Recording& recording, const std::vector<MisreadLabel>& misread) {
  std::vector<char> out(recording.readings.size(), 0);
  for (const MisreadLabel& m : misread)
    for (const std::size_t i : m.readings) out[i] = 1;
  Recording part = recording;
  leave_out_readings(out, part);
  return part;
}

}  // namespace rangecal::diagnosis
