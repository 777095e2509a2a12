// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include "scene_parts.hpp"

namespace rangecal {

namespace {

/// The fields that are not what a scene file need not say.
std::string optics_text(SceneOptics optics) {
  SceneOptics usual;
  usual.sensor.nominal_baseline_mm = optics.sensor.baseline_mm;
  usual.sensor.nominal_focal_mm = optics.sensor.focal_mm;
  std::string text = "sensor: {model: optical";
  for (const scene_parts::OpticsField& field : scene_parts::optics_fields()) {
    const double value = scene_parts::value_of(field, optics);
    if (value != scene_parts::value_of(field, usual)) text += fmt::format(", {}: {}", field.name, value);
  }
  return text + "}\n";
}

}  // namespace

std::string departures_text(const Scene& scene) {
  std::string text = scene.optics ? optics_text(*scene.optics) : std::string();
  if (!scene.effects.empty()) text += "effects:\n";
  for (const auto& [id, parameters] : scene.effects) {
    std::string values;
    for (const auto& [name, value] : parameters)
      values += fmt::format("{}{}: {}", values.empty() ? "" : ", ", name, value);
    text += fmt::format("  {}: {{{}}}\n", id, values);
  }
  return text;
}

}  // namespace rangecal
