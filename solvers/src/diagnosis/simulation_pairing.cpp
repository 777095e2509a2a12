// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <tuple>

#include "diagnosis/simulation_compare.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::diagnosis {
namespace {

/// Geometry of (stop, landmark) under a fit, by labels of one recording.
struct Predicted {
  double f = 0.0, bearing = 0.0;
};

/// Rank of every reading within its (stop, landmark).
std::vector<int> ranks(const Readings& r) {
  std::map<std::pair<int, int>, int> seen;
  std::vector<int> rank;
  for (std::size_t i = 0; i < r.size(); ++i) rank.push_back(seen[{r.stop[i], r.landmark[i]}]++);
  return rank;
}

bool near(const Recording& recording, const Stop& a, const Stop& b) {
  const double sigma = std::max({0.01, 3.0 * sigma_xy_of(recording, a)});
  const double turn = std::max(0.01, 3.0 * sigma_heading_of(recording, a));
  return std::hypot(a.commanded.x_m - b.commanded.x_m, a.commanded.y_m - b.commanded.y_m) < sigma &&
         std::abs(wrap_angle(a.commanded.heading_rad - b.commanded.heading_rad)) < turn;
}

}  // namespace

std::optional<Recording> paired(const Recording& recording, const Recording& simulation,
                                const Rows& simulation_rows, const JointState& state, int first_stop,
                                int first_landmark) {
  if (recording.kind == RecordingKind::pairs) return std::nullopt;
  const bool bearings = recording.readings.has_bearings();
  if (bearings != simulation.readings.has_bearings())
    throw InputError(fmt::format("{}: has {}bearings, and {} has {}", recording.path, bearings ? "" : "no ",
                                 simulation.path, bearings ? "none" : "them"));
  std::map<std::string, int> stop_of, landmark_of;
  for (std::size_t k = 0; k < simulation.stops.size(); ++k)
    stop_of[simulation.stops[k].label] = static_cast<int>(k);
  for (std::size_t l = 0; l < simulation.landmarks.size(); ++l)
    landmark_of[simulation.landmarks[l].label] = static_cast<int>(l);
  for (const Stop& stop : recording.stops) {
    const auto other = stop_of.find(stop.label);
    if (other == stop_of.end() || !near(recording, stop, simulation.stops[other->second]))
      return std::nullopt;
  }
  const CellGeometry geometry = cell_geometry(simulation_rows, state);
  const Cells& cells = simulation_rows.problem.cells;
  std::map<std::pair<int, int>, Predicted> predicted;
  for (int c = 0; c < simulation_rows.cell_count; ++c)
    predicted[{cells.stop[c] - first_stop, cells.landmark[c] - first_landmark}] = {geometry.f[c],
                                                                                   geometry.bearing[c]};
  std::map<std::tuple<int, int, int>, std::size_t> partner;
  const std::vector<int> simulation_rank = ranks(simulation.readings), rank = ranks(recording.readings);
  for (std::size_t i = 0; i < simulation.readings.size(); ++i)
    partner[{simulation.readings.stop[i], simulation.readings.landmark[i], simulation_rank[i]}] = i;

  Recording difference = recording;
  const double root2 = std::numbers::sqrt2;
  difference.sigma_xy_m *= root2;
  difference.sigma_heading_rad *= root2;
  for (Stop& stop : difference.stops) {
    stop.commanded = state.stops[first_stop + stop_of[stop.label]];
    if (stop.sigma_xy_m) *stop.sigma_xy_m *= root2;
    if (stop.sigma_heading_rad) *stop.sigma_heading_rad *= root2;
    if (stop.covariance) *stop.covariance *= 2.0;
  }
  Readings& r = difference.readings;
  const Readings &own = recording.readings, &other = simulation.readings;
  r = Readings{};
  for (const auto& [name, values] : own.covariates) r.covariates[name] = {};
  for (std::size_t i = 0; i < own.size(); ++i) {
    const auto landmark = landmark_of.find(recording.landmarks[own.landmark[i]].label);
    if (landmark == landmark_of.end()) continue;
    const int k = stop_of[recording.stops[own.stop[i]].label];
    const auto match = partner.find({k, landmark->second, rank[i]});
    if (match == partner.end()) continue;
    const std::size_t j = match->second;
    const Predicted& at = predicted.at({k, landmark->second});
    const double range = own.range_m[i] - other.range_m[j] + at.f;
    if (!(range > 0.0)) continue;
    r.stop.push_back(own.stop[i]);
    r.landmark.push_back(own.landmark[i]);
    r.repeat.push_back(own.repeat.empty() ? rank[i] : own.repeat[i]);
    if (!own.time_s.empty()) r.time_s.push_back(own.time_s[i]);
    if (!own.row.empty()) r.row.push_back(own.row[i]);
    r.range_m.push_back(range);
    if (bearings) r.bearing_rad.push_back(wrap_angle(own.bearing_rad[i] - other.bearing_rad[j] + at.bearing));
    for (const auto& [name, values] : own.covariates) r.covariates[name].push_back(values[i]);
  }
  if (r.size() < own.size() / 2) return std::nullopt;
  return difference;
}

}  // namespace rangecal::diagnosis
