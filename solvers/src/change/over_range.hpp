// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {

/// How many distances stand for a calibration's range.
inline constexpr int distances_of_range = 64;

/// Calls visit(f, s) with the reading and the spread [m] at these, evenly over the range. Throws InputError that begins with
/// `who` where a spread is not positive and finite.
template <typename Visit>
void over_range(const Calibration& reference, const char* who, Visit visit) {
  for (int i = 0; i < distances_of_range; ++i) {
    const double d = reference.range_min_m +
                     (i + 0.5) / distances_of_range * (reference.range_max_m - reference.range_min_m);
    const double f = evaluate_polynomial(reference.alpha, d), s = reference.noise.spread(d, f);
    if (!(s > 0.0 && std::isfinite(s)))
      throw InputError(std::string(who) +
                       ": the calibration's noise is not positive and finite over its range");
    visit(f, s);
  }
}

}  // namespace rangecal
