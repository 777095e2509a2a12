// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "closed_form/stop_variance.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// One number read, beside what was predicted of it: its error, the spread s of its noise and the variance of what predicted
/// it, in its unit [m; rad].
struct PredictedNumber {
  double error = 0.0, s = 1.0, variance = 0.0;

  double z() const;  ///< error / sqrt(s^2 + variance)
  /// That its noise, of this shape, is an outlier: both the body and the outliers are blurred by the variance.
  double outlier_probability(const NoiseShapeParameters& shape) const;
};

/// Range and bearing of a landmark at a known place, seen from a stop that may be off its pose by `stop`; alpha, noise and
/// sigma_theta those of `state`. None where the distance or the spread is not positive.
struct PredictedReading {
  PredictedNumber range, bearing;
};
std::optional<PredictedReading> predicted_reading(const JointState& state, const Pose2& pose,
                                                  const StopVariance& stop, const Eigen::Vector2d& landmark_m,
                                                  double radius_m, double range_m, double bearing_rad);

}  // namespace rangecal
