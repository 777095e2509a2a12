// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "diagnosis/generic_effect.hpp"
#include "diagnosis/projector.hpp"

namespace rangecal::diagnosis {

/// A curve without a name: a channel's mean along a covariate, as an effect that a model can hold.
struct CurvePlace {
  std::shared_ptr<GenericEffect> effect;
  std::vector<double>
      sizes;  ///< tau: standard deviations of its parameters that come into question [m] or [rad]
};

/// Curves of range and bearing along every covariate that the recording has:
///
///   smooth      a Gaussian process of Matern's covariance (order 3/2), whose values hang together over much or over little of the
///               readings; along landmarks and stops one value each; of ranges along the distance of each landmark, too
///   one shape   harmonics 1 to 8 of the direction, one sector of directions, one stretch of distance, one step in time
///
/// half the prior mass each. Directions of smooth ones that the calibration absorbs are left out. Sizes: a half, two and
/// eight standard deviations of one reading.
std::vector<CurvePlace> curve_places(const Rows& rows, const Projector& projector, double sigma_theta_rad);

}  // namespace rangecal::diagnosis
