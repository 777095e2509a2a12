// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>

namespace rangecal {

/// Intervals of a dimensionless number: of `width` up to |v| = `even_to`, of equal `ratio` beyond, up to `farthest`.
struct SignedIntervals {
  double width, even_to, ratio, farthest;

  /// 0, 1, .. above 0, -1, -2, .. below.
  int index_of(double v) const {
    const double size = std::min(std::abs(v), farthest);
    const int place = static_cast<int>(
        size < even_to ? size / width : even_to / width + std::log(size / even_to) / std::log(ratio));
    return v < 0.0 ? -1 - place : place;
  }
};

}  // namespace rangecal
