// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal::testing {

/// A recording of readings at known distances and nothing else.
inline Recording pairs_of(std::vector<double> true_m, std::vector<double> reading_m) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.counts.read = recording.counts.used = static_cast<int>(true_m.size());
  recording.pairs.true_m = std::move(true_m);
  recording.pairs.reading_m = std::move(reading_m);
  return recording;
}

/// `count` readings f(d) + spread(f(d)) N(0, 1) at distances drawn from `low` to `high`.
template <typename Curve, typename Spread>
Recording drawn_pairs(Random& random, std::size_t count, double low, double high, const Curve& f,
                      const Spread& spread) {
  std::vector<double> d, y;
  for (std::size_t i = 0; i < count; ++i) {
    d.push_back(random.uniform(low, high));
    const double reading = f(d.back());
    y.push_back(reading + spread(reading) * random.normal());
  }
  return pairs_of(std::move(d), std::move(y));
}

}  // namespace rangecal::testing
