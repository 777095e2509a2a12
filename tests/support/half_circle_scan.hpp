// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

namespace rangecal::test {

/// Ranges [m] of half a circle of beams from (x, 0), in steps of 1 degree: a wall 3 m ahead, three cylinders of 12 cm.
inline std::vector<double> half_circle_from(double x) {
  constexpr double radius = 0.12, degree = std::numbers::pi / 180.0;
  std::vector<double> ranges;
  for (int i = -90; i < 90; ++i) {
    const double c = std::cos(i * degree), s = std::sin(i * degree);
    double range = std::min(3.0 / std::max(c, 0.05), 8.0);
    for (const auto& [at_x, at_y] : {std::pair{1.5, 0.5}, {1.2, -0.7}, {2.0, -0.1}}) {
      const double along = (at_x - x) * c + at_y * s, across = (at_x - x) * s - at_y * c;
      if (along > 0.0 && std::abs(across) < radius)
        range = along - std::sqrt(radius * radius - across * across);
    }
    ranges.push_back(range);
  }
  return ranges;
}

}  // namespace rangecal::test
