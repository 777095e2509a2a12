// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <map>
#include <utility>

#include "robust/residual_shape.hpp"

namespace rangecal {

/// A histogram of the residuals z of one channel and their spreads s [m; rad], for any number of them in constant memory. The
/// intervals of z are 1/4 wide up to |z| = 8 and of equal ratio beyond, those of s have a ratio of 1.3. A cell stands for two
/// points, at its mean of z +- its standard deviation of z.
class ResidualSketch {
 public:
  void add(double z, double s, double weight = 1.0);
  void scale(double factor);
  void clear() { cells.clear(); }
  /// Appends the points of the cells to `points`.
  void append_to(ChannelResiduals& points) const;

  /// By (interval of z, of s): sum w, w z, w z^2, w s.
  std::map<std::pair<int, int>, std::array<double, 4>> cells;
};

}  // namespace rangecal
