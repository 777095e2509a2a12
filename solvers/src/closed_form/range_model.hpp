// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

namespace rangecal {

/// The mean range of a cell (or one pair) beside the distance it is thought to have.
struct RangeSample {
  double d = 0.0;            ///< distance to the surface [m]
  double y = 0.0;            ///< mean reading [m]
  double R = 1.0;            ///< readings
  double mean_square = 0.0;  ///< of the readings about y [m^2]
  double d_variance = 0.0;   ///< of d, by the stop: sigma_s^2 [m^2]
  int landmark = 0, cell = 0, stop = 0;
  Eigen::Vector2d u = Eigen::Vector2d::Zero();  ///< unit vector from the stop to the landmark
};

enum class RangeWeighting { ordinary, d_squared };  ///< weights R, or R / d^4
double weight_of(const RangeSample& sample, RangeWeighting weighting);

struct RangeModel {
  Outcome outcome = Outcome::failed;
  std::string reason;
  Eigen::VectorXd alpha;
  Eigen::MatrixXd alpha_covariance;  ///< where distances are known; else curve_covariance has it
  Noise noise;
  std::vector<Estimate> noise_estimates;
  std::string note;        ///< where the noise could not be told from the stops, or f is not positive
  bool f_positive = true;  ///< at every sample
};

/// alpha by weighted least squares, noise by moments (landmark_calibration.hpp). `landmark_covariance`: one
/// per landmark, empty where distances are known.
RangeModel fit_range_model(const std::vector<RangeSample>& samples, RangeWeighting weighting,
                           const std::vector<Eigen::Matrix2d>& landmark_covariance, std::optional<int> order,
                           const ClosedFormOptions& options);

}  // namespace rangecal
