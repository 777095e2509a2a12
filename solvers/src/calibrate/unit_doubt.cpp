// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/unit_doubt.hpp"

#include <fmt/core.h>

#include <cmath>

#include "rangecal/core/polynomial.hpp"

namespace rangecal {

std::string unit_doubt(const Calibration& calibration) {
  constexpr double most = 20.0;
  const double d = 0.5 * (calibration.range_min_m + calibration.range_max_m);
  if (calibration.alpha.size() == 0 || !(d > 0.0)) return {};
  const double factor = std::abs(evaluate_polynomial(calibration.alpha, d)) / d;
  if (!std::isfinite(factor) || (factor < most && factor * most > 1.0)) return {};
  const bool pairs = calibration.kind == RecordingKind::pairs;
  const char *read = pairs ? "reading_m is" : "range_m is",
             *known = pairs ? "true_m is" : "stops (or taped distances) are";
  return fmt::format(
      "at a distance of {:.4g} m the curve reads {:.4g} m: if the sensor reports metres, {} in another unit",
      d, factor * d, factor > 1.0 ? read : known);
}

}  // namespace rangecal
