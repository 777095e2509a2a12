// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <vector>

#include "correction/search.hpp"

namespace rangecal {

/// Distances from `from` to `to` on which the mean reading g(d) = f(d) + delta r(d) only rises, or only
/// falls.
struct Stretch {
  double from = 0.0, to = 0.0, at_from = 0.0, at_to = 0.0;   ///< d [m], g(d) [m]
  enum class End { turn, jump, window } ends = End::window;  ///< why it ends at `to`: g turns, or jumps
};

/// The mean reading and its parts.
struct MeanReading {
  const Calibration& calibration;                      ///< has f
  std::vector<std::function<double(double)>> changes;  ///< delta r of each effect [m], by d [m]
  std::vector<double> jumps;                           ///< distances at which one of them jumps
  double f(double d) const;
  double at(double d) const;
};

/// The stretches of `range` on which g may come within `reach` of y, ascending. An effect oscillates as fast as it
/// changes for its size: the grid has a dozen points to a period, and every extreme on it is refined. f is
/// followed to where it leaves y by more than the effects together ever do. Cost: some five hundred changes.
std::vector<Stretch> stretches_near(const MeanReading& mean, const SearchedRange& range, double y,
                                    double reach);

}  // namespace rangecal
