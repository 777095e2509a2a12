// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <string>

#include "rangecal/problems/world/scene.hpp"

namespace rangecal::testing {

inline const std::string seed_sensor = "alpha: [0.0525, 0.8838, 0.0584]";

/// A scene file in which every effect that a scene can hold shows at a generous size: ten places 0.3 m apart, two headings
/// each, five landmarks of two radii, ten sweeps 0.2 s apart, a minute from stop to stop. `sensor` makes the curve; `rest`
/// follows at the end.
inline std::string planted_text(const std::string& rest, const std::string& sensor = seed_sensor) {
  std::string text =
      "format: rangecal-scene/1\n"
      "sensor: {" +
      sensor +
      ", noise: {law: f2, sigma: 0.005}, sigma_theta_rad: 0.0087, range_min_m: 0.1, range_max_m: 10}\n"
      "timing: {drive_s: 60, sweep_s: 0.2}\n"
      "repeats: 10\n"
      "landmarks:\n"
      "  list:\n"
      "    - {landmark: A, x_m: 0.42, y_m: 0.71, radius_m: 0.12}\n"
      "    - {landmark: B, x_m: 1.63, y_m: -0.52, radius_m: 0.05}\n"
      "    - {landmark: C, x_m: 2.28, y_m: 1.66, radius_m: 0.12}\n"
      "    - {landmark: D, x_m: 0.87, y_m: -2.35, radius_m: 0.05}\n"
      "    - {landmark: E, x_m: 2.55, y_m: 3.4, radius_m: 0.12}\n"
      "stops:\n"
      "  sigma_xy_m: 0.01\n"
      "  list:\n";
  for (int k = 0; k < 10; ++k)
    for (const char* turn : {"a, heading_rad: 0", "b, heading_rad: 1.5708"})
      text += fmt::format("    - {{stop: {}{}, x_m: {:.1f}, y_m: 0, place: p{}}}\n", k, turn, 0.3 * k, k);
  return text + rest;
}

inline Scene planted_scene(const std::string& effects) {
  return parse_scene(planted_text("effects: {" + effects + "}\n"), "planted", SceneScope::any);
}

}  // namespace rangecal::testing
