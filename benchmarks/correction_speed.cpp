// SPDX-License-Identifier: BSD-3-Clause
// Speed of the most likely distance behind readings, by the table of `rangecal correct` for bags and by exact roots, on one
// thread: 2 * 10^7 readings spread evenly over the range of the fit and its ends, once with bearings and an effect of these.
// "new": the first pass, which makes the cells.
//
//   correction_speed

#include <fmt/format.h>

#include <chrono>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/solvers/correction/correction_table.hpp"

namespace {

using namespace rangecal;

/// A cubic curve over 0.2 to 5 m.
Calibration cubic() {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector4d(-0.02, 1.03, -0.03, 0.004);
  c.noise = {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.01)};
  c.range_min_m = 0.2, c.range_max_m = 5.0;
  return c;
}

/// Nanoseconds of each of `count` calls, and the sum of what they gave.
template <typename Correct>
std::pair<double, double> timed(std::size_t count, const Correct& correct) {
  const auto start = std::chrono::steady_clock::now();
  double sum = 0.0;
  for (std::size_t i = 0; i < count; ++i)
    if (const double d = correct(i); std::isfinite(d)) sum += d;
  return {std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count() * 1e9 /
              static_cast<double>(count),
          sum};
}

void measure(const char* name, const Calibration& calibration, bool by_bearing) {
  constexpr std::size_t readings = 20'000'000, exact = 20'000;
  Random random(seed_from("correction_speed"));
  std::vector<float> y(readings), bearing(readings);
  for (std::size_t i = 0; i < readings; ++i) {
    y[i] = static_cast<float>(random.uniform(0.1, 6.0));
    bearing[i] = static_cast<float>(random.uniform(-std::numbers::pi, std::numbers::pi));
  }
  const EffectCorrector corrector(calibration, {});
  CorrectionTable table(corrector, by_bearing);
  const auto by_table = [&](std::size_t i) { return table(y[i], bearing[i]).distance_m; };
  const auto first = timed(readings, by_table), again = timed(readings, by_table);
  ReadingSetting setting;
  const auto by_roots = timed(exact, [&](std::size_t i) {
    setting.bearing_rad = static_cast<double>(bearing[i]);
    return table.exact(y[i], setting).distance_m;
  });
  fmt::print("{:<12} {:>10.1f} {:>10.1f} {:>12.3g} {:>12.0f} {:>8} {:>8}\n", name, first.first, again.first,
             1e9 / again.first, by_roots.first, table.cells(), table.exact_cells());
}

}  // namespace

int main() {
  fmt::print("{:<12} {:>10} {:>10} {:>12} {:>12} {:>8} {:>8}\n", "curve", "new [ns]", "table [ns]",
             "readings/s", "exact [ns]", "cells", "exact");
  Calibration c = cubic();
  measure("cubic", c, false);
  c.effects["range_eccentricity"] = {{"cosine_m", 0.006}, {"sine_m", -0.004}};
  measure("by bearing", c, true);
  return 0;
}
