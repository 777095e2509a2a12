// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// How well the places of a scene are known [m^2], in the order of the recordings laid end to end. None where
/// the position is exact, was never read, or is not determined.
struct SceneCovariance {
  std::vector<std::optional<Eigen::Matrix2d>> stops, landmarks;
};

/// With H the expected information of the joint likelihood at the calibration's estimates, gamma the globals
/// (curve, landmarks, spreads) and u the stops:
///
///   cov(gamma) = S^-1,   S = H_gg - H_gu H_uu^-1 H_ug
///   cov(u)     = H_uu^-1 + U S^-1 U^T,   U = H_uu^-1 H_ug
///
/// The parameters of effects are held at the calibration's. Empty for kind pairs; no covariance at all where
/// S is not positive definite. Throws InputError as model_residuals. Cost: stops times the square of the
/// globals.
SceneCovariance scene_covariance(std::span<const Recording> recordings, const Calibration& calibration);

}  // namespace rangecal
