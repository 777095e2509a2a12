// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/residual_check.hpp"

#include <cmath>
#include <map>
#include <string>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

constexpr double limit = 4.0;  // standard deviations

void add_range(const Calibration& calibration, double d, double y, ResidualCheck& check) {
  const double f = evaluate_polynomial(calibration.alpha, d);
  const double s = calibration.noise.spread(d, f);
  ++check.ranges;
  if (!(std::abs(y - f) <= limit * s)) ++check.range_outliers;
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
    add_range(calibration, d, y, check);
    const int k = recording.readings.stop[i], l = recording.readings.landmark[i];
    const double f = evaluate_polynomial(calibration.alpha, d);
    ranges.add(k, l, y - f, calibration.noise.spread(d, f));
    if (!calibration.sigma_theta_rad) continue;
    const double direction = std::atan2(sight.y(), sight.x()) - pose.heading_rad;
    const double off = wrap_angle(recording.readings.bearing_rad[i] - direction);
    ++check.bearings;
    if (!(std::abs(off) <= limit * calibration.sigma_theta_rad->value)) ++check.bearing_outliers;
    bearings.add(k, l, off, calibration.sigma_theta_rad->value);
  }
  ranges.pool(pooled.range_sq, pooled.range_dof);
  bearings.pool(pooled.bearing_sq, pooled.bearing_dof);
}

bool too_many(int outliers, int readings) { return outliers >= 3 && outliers > 0.003 * readings; }

}  // namespace

bool ResidualCheck::suspicious() const {
  return too_many(range_outliers, ranges) || too_many(bearing_outliers, bearings);
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
        add_range(calibration, recording.pairs.true_m[i], recording.pairs.reading_m[i], check);
  }
  constexpr double fewest = 20.0;  // degrees of freedom: the ratio is then known to 16 %
  if (pooled.range_dof >= fewest) check.range_repeats = std::sqrt(pooled.range_sq / pooled.range_dof);
  if (pooled.bearing_dof >= fewest) check.bearing_repeats = std::sqrt(pooled.bearing_sq / pooled.bearing_dof);
  return check;
}

}  // namespace rangecal
