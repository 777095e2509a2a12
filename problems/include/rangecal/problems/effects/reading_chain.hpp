// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal {

/// What effects change of a reading together, added in the order of their stages:
///   change = sum_i h_i(d, before_i),   before_i = sum of the ranges h_j of the earlier stages     [m]
/// A pull of the spot that has a period of 3 mm at 0.6 m is another one where a cover lengthens the way of the light by 3 mm.
class ReadingChain {
 public:
  /// The view as an effect of the next stage gets it.
  ReadingView<double> seen(ReadingView<double> view) const {
    view.before_light = path_m_;
    view.before_spot = path_m_ + light_m_;
    return view;
  }
  void add(const Effect& effect, const double* p, ReadingView<double> view) {
    view.before_light = path_m_;
    view.before_spot = path_m_ + light_m_;
    const ReadingChange<double> own = effect.reading(view, p);
    const Stage stage = effect.info().stage;
    if (stage == Stage::path) path_m_ += own.range;
    if (stage == Stage::light) light_m_ += own.range;
    sum_.range += own.range;
    sum_.bearing += own.bearing;
    sum_.range_log_variance += own.range_log_variance;
    sum_.bearing_log_variance += own.bearing_log_variance;
  }
  const ReadingChange<double>& sum() const { return sum_; }

 private:
  double path_m_ = 0.0, light_m_ = 0.0;
  ReadingChange<double> sum_;
};

}  // namespace rangecal
