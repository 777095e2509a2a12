// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/residual_check.hpp"

#include <cmath>
#include <map>
#include <string>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/distributions.hpp"

namespace rangecal {
namespace {

constexpr double limit = 4.0;  // standard deviations

/// Of reading i, by the row of its file where it came from one.
std::string place_of(std::size_t i, const std::vector<int>& rows, const char* file) {
  return i < rows.size() ? "row " + std::to_string(rows[i]) + " of " + file
                         : "reading " + std::to_string(i + 1);
}

/// Where |error| is beyond the limit; keeps the farthest.
template <typename Place>
bool is_outlier(double error, double stated, ResidualCheck::Farthest& farthest, const Place& place) {
  const double z = std::abs(error) / stated;
  if (z > farthest.sigmas && std::isfinite(z)) {
    farthest.sigmas = z;
    if (z > limit) farthest.place = place();
  }
  return !(std::abs(error) <= limit * stated);
}

template <typename Place>
void add_range(const Calibration& calibration, double d, double y, ResidualCheck& check, const Place& place) {
  const double f = calibration.f(d);
  ++check.ranges;
  if (is_outlier(y - f, calibration.noise.spread(d, f), check.farthest_range, place)) ++check.range_outliers;
}

/// Mean square of the repeats about their cell's mean, in units of the stated spread.
struct Repeats {
  struct Cell {
    double sum = 0.0, sum_sq = 0.0, stated_sq = 0.0;
    int count = 0;
  };
  std::map<std::pair<int, int>, Cell> cells;

  void add(int stop, int landmark, double error, double stated) {
    Cell& cell = cells[{stop, landmark}];
    cell.sum += error;
    cell.sum_sq += error * error;
    cell.stated_sq += stated * stated;
    ++cell.count;
  }
  void pool(double& sum_sq, double& dof) const {
    for (const auto& [key, cell] : cells) {
      if (cell.count < 2 || !(cell.stated_sq > 0.0)) continue;
      sum_sq += (cell.sum_sq - cell.sum * cell.sum / cell.count) / (cell.stated_sq / cell.count);
      dof += cell.count - 1;
    }
  }
};

struct Pooled {
  double range_sq = 0.0, range_dof = 0.0, bearing_sq = 0.0, bearing_dof = 0.0;
};

void check_landmarks(const Recording& recording, int index, const Calibration& calibration,
                     ResidualCheck& check, Pooled& pooled) {
  Repeats ranges, bearings;
  std::map<std::string, Eigen::Vector2d> landmarks;
  for (const LandmarkEstimate& l : calibration.landmarks)
    if (l.recording == index) landmarks[l.label] = l.position_m;
  std::map<std::string, Pose2> stops;
  for (const StopEstimate& s : calibration.stops)
    if (s.recording == index) stops[s.label] = s.pose;
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const Landmark& landmark = recording.landmarks[recording.readings.landmark[i]];
    const Stop& stop = recording.stops[recording.readings.stop[i]];
    const auto seen = landmarks.find(landmark.label);
    if (seen == landmarks.end()) continue;
    const auto estimated = stops.find(stop.label);
    const Pose2 pose = estimated == stops.end() ? stop.commanded : estimated->second;
    const Eigen::Vector2d sight = seen->second - Eigen::Vector2d(pose.x_m, pose.y_m);
    const double d = sight.norm() - landmark.radius_m, y = recording.readings.range_m[i];
    const auto place = [&] { return place_of(i, recording.readings.row, "observations.csv"); };
    add_range(calibration, d, y, check, place);
    const int k = recording.readings.stop[i], l = recording.readings.landmark[i];
    const double f = calibration.f(d);
    ranges.add(k, l, y - f, calibration.noise.spread(d, f));
    if (!calibration.sigma_theta_rad || !recording.readings.has_bearings()) continue;
    const double direction = std::atan2(sight.y(), sight.x()) - pose.heading_rad;
    const double off = wrap_angle(recording.readings.bearing_rad[i] - direction);
    ++check.bearings;
    if (is_outlier(off, calibration.sigma_theta_rad->value, check.farthest_bearing, place))
      ++check.bearing_outliers;
    bearings.add(k, l, off, calibration.sigma_theta_rad->value);
  }
  ranges.pool(pooled.range_sq, pooled.range_dof);
  bearings.pool(pooled.bearing_sq, pooled.bearing_dof);
}

bool too_many(int outliers, int readings) { return outliers >= 3 && outliers > 0.003 * readings; }

bool too_far(const ResidualCheck::Farthest& farthest, int readings) {
  constexpr double rate = 1e-3;  // of recordings
  return readings * normal_two_sided(farthest.sigmas) < rate;
}

}  // namespace

bool ResidualCheck::suspicious() const {
  return too_many(range_outliers, ranges) || too_many(bearing_outliers, bearings) ||
         (range_outliers > 0 && too_far(farthest_range, ranges)) ||
         (bearing_outliers > 0 && too_far(farthest_bearing, bearings));
}

bool ResidualCheck::mostly_constant_at_stops() const {
  return range_repeats.value_or(1.0) < 0.5 || bearing_repeats.value_or(1.0) < 0.5;
}

ResidualCheck check_residuals(std::span<const Recording> recordings, const Calibration& calibration) {
  ResidualCheck check;
  Pooled pooled;
  if (calibration.alpha.size() == 0 || !calibration.alpha.allFinite()) return check;
  for (std::size_t index = 0; index < recordings.size(); ++index) {
    const Recording& recording = recordings[index];
    if (recording.kind == RecordingKind::landmarks)
      check_landmarks(recording, static_cast<int>(index), calibration, check, pooled);
    else
      for (std::size_t i = 0; i < recording.pairs.size(); ++i)
        add_range(calibration, recording.pairs.true_m[i], recording.pairs.reading_m[i], check,
                  [&] { return place_of(i, recording.pairs.row, "pairs.csv"); });
  }
  constexpr double fewest = 20.0;  // degrees of freedom: the ratio is then known to 16 %
  if (pooled.range_dof >= fewest) check.range_repeats = std::sqrt(pooled.range_sq / pooled.range_dof);
  if (pooled.bearing_dof >= fewest) check.bearing_repeats = std::sqrt(pooled.bearing_sq / pooled.bearing_dof);
  return check;
}

}  // namespace rangecal
