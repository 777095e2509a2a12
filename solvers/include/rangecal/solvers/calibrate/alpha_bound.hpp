// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <span>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// The Cramer-Rao bound of the curve's coefficients: standard deviations of alpha_0 .. alpha_n, alpha_i in m^(1-i), that no
/// unbiased estimate from these readings falls below.
struct AlphaBound {
  Eigen::VectorXd at_estimate;
  /// At the true stops and landmarks, where every stop and every landmark that a reading sees has a true place; curve and
  /// sigmas as estimated, since no recording holds true ones.
  std::optional<Eigen::VectorXd> at_truth;
};

/// From the expected information (cramer_rao_bound): landmarks with noise and sigma_theta as unknowns, stops with their
/// prior integrated out (commanded ones where the calibration has none); pairs with the noise as unknown. None where the
/// calibration has no curve, no sigma_theta, effects or a noise shape of its own, was not made of these recordings, or the
/// information is singular. Cost: one pass over the cells, and the cube of the globals.
std::optional<AlphaBound> alpha_bound(std::span<const Recording> recordings, const Calibration& calibration);

/// Sets `Calibration::bound_alpha_std` of those of these recordings that have an answer: `at_estimate`, none where there is no
/// bound.
void set_alpha_bounds(std::span<const Recording> recordings, std::span<Calibration> calibrations);

}  // namespace rangecal
