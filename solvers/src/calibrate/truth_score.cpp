// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/truth_score.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <map>

#include "rangecal/solvers/correction/correct.hpp"

namespace rangecal {
namespace {

using Key = std::pair<int, std::string>;

struct Sums {
  double raw = 0.0, corrected = 0.0;
  int readings = 0;
};

void add_reading(const Calibration& calibration, double d, double y, Sums& sums) {
  const double corrected = least_squares_distance(calibration, y);
  sums.raw += (y - d) * (y - d);
  sums.corrected += (corrected - d) * (corrected - d);
  ++sums.readings;
}

bool has_curve(const Calibration& c) {
  return c.alpha.size() > 0 && c.alpha.allFinite() && c.noise.parameters.allFinite() &&
         c.range_min_m >= 0.0 && c.range_max_m > c.range_min_m;
}

}  // namespace

TruthScore score_against_truth(std::span<const Recording> recordings, const Calibration& calibration,
                               const Calibration* stops) {
  TruthScore score;
  std::map<Key, Pose2> poses;
  if (stops)
    for (const StopEstimate& stop : stops->stops) poses[{stop.recording, stop.label}] = stop.pose;
  std::map<Key, const LandmarkEstimate*> estimates;
  for (const LandmarkEstimate& landmark : calibration.landmarks)
    estimates[{landmark.recording, landmark.label}] = &landmark;

  double square = 0.0, strain = 0.0;
  int strained = 0;
  Sums sums;
  for (std::size_t index = 0; index < recordings.size(); ++index) {
    const Recording& recording = recordings[index];
    const int number = static_cast<int>(index);
    if (recording.kind == RecordingKind::pairs) {
      for (std::size_t i = 0; has_curve(calibration) && i < recording.pairs.size(); ++i)
        add_reading(calibration, recording.pairs.true_m[i], recording.pairs.reading_m[i], sums);
      continue;
    }
    const Truth& truth = recording.truth;
    for (std::size_t l = 0; l < truth.landmarks.size(); ++l) {
      const auto found = estimates.find({number, recording.landmarks[l].label});
      if (!truth.landmarks[l] || found == estimates.end()) continue;
      const Eigen::Vector2d error = found->second->position_m - *truth.landmarks[l];
      square += error.squaredNorm();
      ++score.landmarks;
      std::optional<double> least;  // by the larger of the two covariances
      for (const auto* covariance : {&found->second->covariance, &found->second->covariance_by_stops}) {
        if (!*covariance || !((*covariance)->determinant() > 0.0)) continue;
        const double own = 0.5 * error.dot((*covariance)->inverse() * error);
        least = std::min(least.value_or(own), own);
      }
      if (least) {
        strain += *least;
        ++strained;
      }
    }
    if (!has_curve(calibration)) continue;
    for (std::size_t i = 0; i < recording.readings.size(); ++i) {
      const int k = recording.readings.stop[i], l = recording.readings.landmark[i];
      if (static_cast<std::size_t>(l) >= truth.landmarks.size() || !truth.landmarks[l]) continue;
      Pose2 pose = recording.stops[k].commanded;
      if (static_cast<std::size_t>(k) < truth.stops.size() && truth.stops[k]) {
        pose = *truth.stops[k];
      } else {
        score.estimated_stops = true;
        if (const auto found = poses.find({number, recording.stops[k].label}); found != poses.end())
          pose = found->second;
      }
      const double d = (*truth.landmarks[l] - Eigen::Vector2d(pose.x_m, pose.y_m)).norm() -
                       recording.landmarks[l].radius_m;
      if (d > 0.0) add_reading(calibration, d, recording.readings.range_m[i], sums);
    }
  }
  if (score.landmarks > 0) score.landmark_rmse_m = std::sqrt(square / score.landmarks);
  if (strained > 0) score.landmark_strain = std::sqrt(strain / strained);
  score.readings = sums.readings;
  if (sums.readings > 0) {
    score.rmse_raw_m = std::sqrt(sums.raw / sums.readings);
    score.rmse_corrected_m = std::sqrt(sums.corrected / sums.readings);
    if (sums.corrected > 0.0) score.mse_ratio = sums.raw / sums.corrected;
  }
  return score;
}

}  // namespace rangecal
