// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

namespace rangecal::extract {

/// The range that a beam measures to a cylinder, and its derivatives.
struct ArcPoint {
  double range_m = 0.0;
  Eigen::Vector3d slope = Eigen::Vector3d::Zero();  ///< by s [1], b [m/rad], R [1]
};

/// A cylinder of radius R [m] with its nearest point at s [m] and its axis in direction b [rad], at a bearing [rad]:
///   r = D cos psi - sqrt(R^2 - D^2 sin^2 psi),   psi = bearing - b,   D = s + R.
/// Beyond the edge and just inside it, the depth sqrt(...) is held at its value for D |sin psi| = 0.995 R.
inline ArcPoint arc_point(double s, double b, double R, double bearing) {
  const double axis = s + R, psi = bearing - b, aside = axis * std::sin(psi);
  const double depth = std::sqrt(std::max(R * R - aside * aside, 1e-2 * R * R));
  const double by_axis = std::cos(psi) + aside * std::sin(psi) / depth;
  return {axis * std::cos(psi) - depth,
          {by_axis, aside - aside * axis * std::cos(psi) / depth, by_axis - R / depth}};
}

}  // namespace rangecal::extract
