// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal {

/// What an effect does to a reading per unit of one parameter, by a central difference over +-difference_step(): for effects
/// whose slope() has no formula.
inline ReadingChange<double> central_difference(const Effect& effect, const ReadingView<double>& at,
                                                const double* p, int parameter) {
  const std::vector<EffectParameter>& parameters = effect.info().parameters;
  const double step = difference_step(parameters[static_cast<std::size_t>(parameter)], p[parameter]);
  std::vector<double> moved(p, p + parameters.size());
  double& value = moved[static_cast<std::size_t>(parameter)];
  value = p[parameter] + step;
  const ReadingChange<double> above = effect.reading(at, moved.data());
  value = p[parameter] - step;
  const ReadingChange<double> below = effect.reading(at, moved.data());
  const auto slope = [step](double high, double low) { return (high - low) / (2.0 * step); };
  return {.range = slope(above.range, below.range),
          .bearing = slope(above.bearing, below.bearing),
          .range_log_variance = slope(above.range_log_variance, below.range_log_variance),
          .bearing_log_variance = slope(above.bearing_log_variance, below.bearing_log_variance)};
}

}  // namespace rangecal
