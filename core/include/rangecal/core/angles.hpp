// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace rangecal {

/// The angle wrapped to (-pi, pi] [rad].
inline double wrap_angle(double angle) {
  if (angle > -std::numbers::pi && angle <= std::numbers::pi) return angle;
  const double wrapped = std::remainder(angle, 2.0 * std::numbers::pi);  // in [-pi, pi]
  return wrapped <= -std::numbers::pi ? std::numbers::pi : wrapped;
}

/// The shortest arc [from, to], counter-clockwise, that holds the angles [rad, at least one]: from > to where it holds pi. All
/// the circle, [-pi, pi], where no two neighbours are more than 45 degrees apart.
inline std::pair<double, double> arc_of(std::vector<double> angles) {
  for (double& angle : angles) angle = wrap_angle(angle);
  std::sort(angles.begin(), angles.end());
  double from = angles.front(), to = angles.back(), widest = from + 2.0 * std::numbers::pi - to;
  for (std::size_t i = 1; i < angles.size(); ++i)
    if (const double gap = angles[i] - angles[i - 1]; gap > widest)
      widest = gap, from = angles[i], to = angles[i - 1];
  if (widest <= 0.25 * std::numbers::pi) return {-std::numbers::pi, std::numbers::pi};
  return {from, to};
}

/// Whether the angle [rad] lies on an arc of `arc_of`.
inline bool is_on_arc(double angle, const std::pair<double, double>& arc) {
  const double wrapped = wrap_angle(angle);
  if (arc.first <= arc.second) return wrapped >= arc.first && wrapped <= arc.second;
  return wrapped >= arc.first || wrapped <= arc.second;
}

}  // namespace rangecal
