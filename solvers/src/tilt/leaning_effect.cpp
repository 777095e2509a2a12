// SPDX-License-Identifier: BSD-3-Clause
#include "tilt/leaning_effect.hpp"

#include <fmt/format.h>

#include <cmath>

#include "rangecal/problems/effects/central_difference.hpp"

namespace rangecal {
namespace {

const Effect& plane() { return *find_effect("tilt"); }

/// A lean of 3 degrees under a tilt of 3; at most one of 30 degrees under one of 10.
constexpr double typical = 0.0027, largest = 0.1;

}  // namespace

LeaningEffect::LeaningEffect(int landmarks) {
  info_ = plane().info();
  info_.id = "leaning_cylinders";
  for (int l = 0; l < landmarks; ++l)
    for (const char* axis : {"x", "y"})
      info_.parameters.push_back({.name = fmt::format("lean_{}_{}_rad", axis, l),
                                  .typical = typical,
                                  .low = -largest,
                                  .high = largest,
                                  .linear = true});
}

ReadingChange<double> LeaningEffect::reading(const ReadingView<double>& at, const double* p) const {
  ReadingChange<double> change = plane().reading(at, p);
  const double b0 = 0.5 * std::atan2(p[1], p[0]), height = std::sin(at.bearing - b0);
  const double phi = at.heading + at.bearing, nx = std::cos(phi), ny = std::sin(phi);
  const double* w = p + 2 + 2 * static_cast<std::ptrdiff_t>(at.landmark);
  change.range += at.before_curve(at.axis_distance * height * (w[0] * nx + w[1] * ny));
  change.bearing += height * (w[1] * nx - w[0] * ny);
  return change;
}

std::optional<ReadingChange<double>> LeaningEffect::slope(const ReadingView<double>& at, const double* p,
                                                          int parameter) const {
  if (parameter < 2) return std::nullopt;
  if ((parameter - 2) / 2 != at.landmark) return ReadingChange<double>{};
  return central_difference(*this, at, p, parameter);
}

}  // namespace rangecal
