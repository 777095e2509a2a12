// SPDX-License-Identifier: BSD-3-Clause
#include "recursive/predicted_reading.hpp"

#include <algorithm>
#include <cmath>

#include "joint_ml/blocks.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {

double PredictedNumber::z() const { return error / std::sqrt(s * s + variance); }

double PredictedNumber::outlier_probability(const NoiseShapeParameters& shape) const {
  const double blurred = std::sqrt(s * s + variance);
  NoiseShapeParameters seen = shape;
  if (shape.shape == NoiseShape::contaminated) {
    const double k = shape.outlier_scale, share = s * s / (blurred * blurred);
    seen.outlier_scale = std::sqrt(1.0 + (k * k - 1.0) * share);
  }
  return log_density(seen, error / blurred, blurred).outlier;
}

std::optional<PredictedReading> predicted_reading(const JointState& state, const Pose2& pose,
                                                  const StopVariance& stop, const Eigen::Vector2d& landmark_m,
                                                  double radius_m, double range_m, double bearing_rad) {
  const Sight sight(landmark_m, pose, radius_m);
  const Eigen::Vector2d n = (landmark_m - Eigen::Vector2d(pose.x_m, pose.y_m)).normalized();
  const double f = evaluate_polynomial(state.alpha, sight.d), s = state.noise.spread(sight.d, f),
               slope = evaluate_derivative(state.alpha, sight.d), D = sight.d + radius_m;
  if (!(sight.d > 0.0) || !(s > 0.0)) return std::nullopt;
  PredictedReading reading;
  reading.range = {range_m - f, s, slope * slope * stop.along(n)};
  reading.bearing = {wrap_angle(bearing_rad - sight.bearing), state.sigma_theta_rad,
                     stop.off_line({n.y(), -n.x()}, D) / (D * D)};
  return reading;
}

}  // namespace rangecal
