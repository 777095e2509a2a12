// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "closed_form/stop_variance.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// One number that was read, compared with its prediction: the error, the spread s of its noise and the variance of the
/// prediction, in its unit [m; rad].
struct PredictedNumber {
  double error = 0.0, s = 1.0, variance = 0.0;

  double z() const;  ///< error / sqrt(s^2 + variance)
  /// Probability that it is an outlier under this noise shape. The variance is added to that of the body and of the outliers.
  double outlier_probability(const NoiseShapeParameters& shape) const;
};

/// Range and bearing of a landmark at a known place, seen from a stop whose pose has the variance `stop`; alpha, noise and
/// sigma_theta are those of `state`. None if the distance or the spread is not positive.
struct PredictedReading {
  PredictedNumber range, bearing;
};
std::optional<PredictedReading> predicted_reading(const JointState& state, const Pose2& pose,
                                                  const StopVariance& stop, const Eigen::Vector2d& landmark_m,
                                                  double radius_m, double range_m, double bearing_rad);

}  // namespace rangecal
