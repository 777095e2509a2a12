// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/joint_problem.hpp"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <map>
#include <numeric>
#include <string>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/problems/landmarks/cell_order.hpp"

namespace rangecal {
namespace {

struct Offsets {
  int stop = 0, landmark = 0;
};

void append_stops(const Recording& recording, int index, JointProblem& problem) {
  const bool walk = recording.stop_error == StopErrorModel::random_walk;
  std::map<std::string, int> places;
  std::string previous_place;
  for (std::size_t k = 0; k < recording.stops.size(); ++k) {
    const Stop& stop = recording.stops[k];
    StopPrior prior;
    prior.commanded = stop.commanded;
    prior.sigma_xy_m = sigma_xy_of(recording, stop);
    prior.sigma_heading_rad = sigma_heading_of(recording, stop);
    const std::string where = recording.path + ": stop '" + stop.label + "'";
    if (stop.covariance) set_covariance(checked_covariance(stop, where), prior);
    prior.chained = walk && k > 0;
    prior.recording = index;
    const auto known = stop.place.empty() ? places.end() : places.find(stop.place);
    if (known == places.end()) {
      prior.place = problem.place_count++;
      if (!stop.place.empty()) places.emplace(stop.place, prior.place);
    } else {
      prior.place = known->second;
      prior.opens_place = false;
      if (walk && stop.place != previous_place)
        throw InputError(where + " returns to place '" + stop.place +
                         "', which a random walk cannot do; use error: independent");
    }
    if (!prior.opens_place) {
      require_turn_alone(stop, where);
      prior.shape.reset();
    }
    previous_place = stop.place;
    problem.stops.push_back(prior);
    problem.sigma_s_shared.push_back(recording.estimate_sigma_xy && !stop.sigma_xy_m && !stop.covariance);
  }
  problem.estimate_sigma_s = problem.estimate_sigma_s || recording.estimate_sigma_xy;
}

/// Mean and mean square deviation of the readings `rows` (indices into the recording), appended as one cell.
void append_cell(const Recording& recording, std::span<const std::size_t> rows, Offsets offset,
                 Cells& cells) {
  const Readings& r = recording.readings;
  const double count = static_cast<double>(rows.size());
  const auto bearing_of = [&](std::size_t i) { return r.has_bearings() ? r.bearing_rad[i] : 0.0; };
  const double first_bearing = bearing_of(rows[0]);
  double range_sum = 0.0, turn_sum = 0.0;
  for (std::size_t i : rows) {
    range_sum += r.range_m[i];
    turn_sum += wrap_angle(bearing_of(i) - first_bearing);
  }
  const double range_mean = range_sum / count, turn_mean = turn_sum / count;
  double range_square = 0.0, turn_square = 0.0;
  for (std::size_t i : rows) {
    const double range = r.range_m[i] - range_mean;
    const double turn = wrap_angle(bearing_of(i) - first_bearing) - turn_mean;
    range_square += range * range;
    turn_square += turn * turn;
  }
  const int landmark = r.landmark[rows[0]];
  cells.stop.push_back(offset.stop + r.stop[rows[0]]);
  cells.landmark.push_back(offset.landmark + landmark);
  cells.count.push_back(count);
  cells.range_weight.push_back(count);
  const SilentBearing silent(count);
  cells.bearing_weight.push_back(r.has_bearings() ? count : silent.weight);
  cells.range_mean.push_back(range_mean);
  cells.range_mean_square.push_back(range_square / count);
  cells.bearing_mean.push_back(wrap_angle(first_bearing + turn_mean));
  cells.bearing_mean_square.push_back(r.has_bearings() ? turn_square / count : silent.mean_square);
  cells.radius_m.push_back(recording.landmarks[landmark].radius_m);
}

void append_cells(const Recording& recording, Offsets offset, Grouping grouping, Cells& cells) {
  const std::vector<std::size_t> order = cell_order(recording.readings);
  for (std::size_t begin = 0; begin < order.size();) {
    std::size_t end = begin + 1;
    if (grouping == Grouping::cells)
      while (end < order.size() && same_cell(recording.readings, order[begin], order[end])) ++end;
    append_cell(recording, std::span(order).subspan(begin, end - begin), offset, cells);
    begin = end;
  }
}

/// The solvers hold a place as dim (2 dim + columns) doubles that an int counts: dim its position and
/// headings, columns those of the curve, the sigmas and two for each landmark seen.
void check_places(std::span<const Recording> recordings, const JointProblem& problem) {
  constexpr double largest = std::numeric_limits<int>::max(), curve_and_sigmas = 32.0;
  std::vector<double> dim(problem.place_count, 2.0), seen(problem.place_count, 0.0);
  for (int k = 0; k < problem.stop_count(); ++k) {
    const StopPrior& prior = problem.stops[k];
    dim[prior.place] += prior.sigma_heading_rad > 0.0;
    seen[prior.place] += problem.cells.stop_begin[k + 1] - problem.cells.stop_begin[k];
    const double landmarks = std::min<double>(seen[prior.place], problem.landmark_count());
    if (dim[prior.place] * (2.0 * dim[prior.place] + 2.0 * landmarks + curve_and_sigmas) > largest)
      throw InputError(recordings[prior.recording].path +
                       ": a place holds too many stops and landmarks to be solved for: " +
                       std::to_string(static_cast<int>(dim[prior.place]) - 2) +
                       " stops with headings of their own");
  }
}

}  // namespace

JointProblem make_joint_problem(std::span<const Recording> recordings, Grouping grouping) {
  JointProblem problem;
  for (std::size_t index = 0; index < recordings.size(); ++index) {
    const Recording& recording = recordings[index];
    if (recording.kind != RecordingKind::landmarks)
      throw InputError(recording.path + ": is a recording of kind pairs; this needs kind landmarks");
    if (index == 0) problem.reads_bearings = recording.readings.has_bearings();
    if (recording.readings.has_bearings() != problem.reads_bearings)
      throw InputError(recording.path + ": has " + (problem.reads_bearings ? "no " : "") +
                       "bearings, and the recordings before it have " +
                       (problem.reads_bearings ? "them" : "none") + "; calibrate them apart");
    const Offsets offset{problem.stop_count(), problem.landmark_count()};
    append_stops(recording, static_cast<int>(index), problem);
    append_cells(recording, offset, grouping, problem.cells);
    for (const Landmark& landmark : recording.landmarks) {
      problem.landmark_radius_m.push_back(landmark.radius_m);
      problem.landmark_recording.push_back(static_cast<int>(index));
    }
    for (KnownDistance taped : recording.known_distances) {
      taped.from += offset.landmark;
      taped.to += offset.landmark;
      problem.known_distances.push_back(taped);
    }
  }
  Cells& cells = problem.cells;
  cells.stop_begin.assign(problem.stops.size() + 1, 0);
  for (int stop : cells.stop) ++cells.stop_begin[stop + 1];
  std::partial_sum(cells.stop_begin.begin(), cells.stop_begin.end(), cells.stop_begin.begin());
  check_places(recordings, problem);
  problem.readings = std::accumulate(cells.count.begin(), cells.count.end(), 0.0);
  return problem;
}

JointProblem merge_rows(const JointProblem& rows, const std::vector<char>& kept,
                        std::vector<int>* cell_of_row) {
  const Cells& r = rows.cells;
  JointProblem merged = rows;
  merged.rows_alike = false;
  Cells& c = merged.cells;
  c = Cells{};
  std::vector<int> cell(r.size(), -1);
  std::vector<std::size_t> first;  // row of each cell
  for (std::size_t i = 0; i < r.size(); ++i) {
    if (!kept.empty() && !kept[i]) continue;
    const bool same = !first.empty() && r.stop[i] == c.stop.back() && r.landmark[i] == c.landmark.back() &&
                      r.effect_slope.empty();
    if (!same) {
      first.push_back(i);
      c.stop.push_back(r.stop[i]);
      c.landmark.push_back(r.landmark[i]);
      c.radius_m.push_back(r.radius_m[i]);
      c.count.push_back(0.0);
      c.range_mean.push_back(0.0);
      c.bearing_mean.push_back(0.0);
      if (!r.effect_slope.empty()) {
        c.effect_slope.push_back(r.effect_slope[i]);
        c.effect_slope_at_m.push_back(r.effect_slope_at_m[i]);
      }
    }
    cell[i] = static_cast<int>(first.size()) - 1;
    c.count.back() += r.count[i];
    c.range_mean.back() += r.count[i] * r.range_mean[i];
    c.bearing_mean.back() += r.count[i] * wrap_angle(r.bearing_mean[i] - r.bearing_mean[first.back()]);
  }
  c.range_weight = c.bearing_weight = c.count;
  if (!rows.reads_bearings)
    for (double& weight : c.bearing_weight) weight = SilentBearing(weight).weight;
  c.range_mean_square.assign(c.size(), 0.0);
  c.bearing_mean_square.assign(c.size(), 0.0);
  for (std::size_t j = 0; j < c.size(); ++j) {
    c.range_mean[j] /= c.count[j];
    c.bearing_mean[j] = wrap_angle(r.bearing_mean[first[j]] + c.bearing_mean[j] / c.count[j]);
  }
  for (std::size_t i = 0; i < r.size(); ++i) {
    if (cell[i] < 0) continue;
    const std::size_t j = static_cast<std::size_t>(cell[i]);
    const double range = r.range_mean[i] - c.range_mean[j],
                 turn = wrap_angle(r.bearing_mean[i] - c.bearing_mean[j]);
    c.range_mean_square[j] += r.count[i] * (range * range + r.range_mean_square[i]) / c.count[j];
    c.bearing_mean_square[j] += r.count[i] * (turn * turn + r.bearing_mean_square[i]) / c.count[j];
  }
  c.stop_begin.assign(merged.stops.size() + 1, 0);
  for (const int stop : c.stop) ++c.stop_begin[stop + 1];
  std::partial_sum(c.stop_begin.begin(), c.stop_begin.end(), c.stop_begin.begin());
  merged.readings = std::accumulate(c.count.begin(), c.count.end(), 0.0);
  if (cell_of_row) *cell_of_row = std::move(cell);
  return merged;
}

double silent_bearing_nll(const JointProblem& problem) {
  return problem.reads_bearings ? 0.0 : SilentBearing::nll(problem.readings);
}

double mean_range(const JointProblem& problem) {
  const std::vector<double>& means = problem.cells.range_mean;
  const double sum = std::accumulate(means.begin(), means.end(), 0.0);
  return sum > 0.0 ? sum / static_cast<double>(means.size()) : 1.0;
}

double no_sigma_s(const JointProblem& problem) { return 4e-7 * mean_range(problem); }

double sigma_xy_of(const JointProblem& problem, const JointState& state, int k) {
  return problem.sigma_s_shared[k] && state.sigma_s_m ? *state.sigma_s_m : problem.stops[k].sigma_xy_m;
}

}  // namespace rangecal
