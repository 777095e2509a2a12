// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "closed_form/range_model.hpp"
#include "closed_form/stop_variance.hpp"
#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_ranges.hpp"

namespace rangecal {

/// Landmarks as the closed forms see them; `used` are those whose position is determined.
struct LandmarkMap {
  std::vector<Eigen::Vector2d> position;
  std::vector<Eigen::Matrix2d> covariance;
  std::vector<char> used;
};

/// From the bearings; where they do not determine a landmark its position is the raw one, and it is not used.
LandmarkMap map_from(const JointProblem& problem, const LandmarksFromBearings& found);
/// From ranges alone; a landmark that they do not determine is not used.
LandmarkMap map_from(const LandmarksFromRanges& found);

/// The commanded position of a stop [m].
Eigen::Vector2d commanded_position(const JointProblem& problem, int stop);

/// The cells of used landmarks beside their distances from the commanded stops.
std::vector<RangeSample> samples_at(const JointProblem& problem, const LandmarkMap& map,
                                    const std::vector<StopVariance>& stops);

/// sigma_theta with its standard deviation, from the moments of the angles at the map.
std::optional<Estimate> sigma_theta_at(const JointProblem& problem, const LandmarkMap& map,
                                       const std::vector<StopVariance>& stops);

/// A closed form's calibration before its first step; `too_few_data`, and why, where none can come of the problem at all.
Calibration begun_calibration(const JointProblem& problem, Method method);

/// Adds to a reason, after "; ".
void append_reason(std::string& text, const std::string& more);

/// Landmarks, alpha, noise, range and reason of a calibration; its outcome only where the model has none to
/// give.
void fill_calibration(const JointProblem& problem, const LandmarkMap& map, const RangeModel& model,
                      const std::vector<RangeSample>& samples, Calibration& result);

/// sigma_theta of a calibration: the one given, or the estimate, or none and why; none of ranges alone.
void fill_sigma_theta(const JointProblem& problem, const LandmarkMap& map,
                      const std::vector<StopVariance>& stops, const ClosedFormOptions& options,
                      Calibration& result);

}  // namespace rangecal
