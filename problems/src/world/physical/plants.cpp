// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/plants.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "plant_entry.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::world {
namespace {

const std::vector<PlantEntry>& entries() {
  static const std::vector<PlantEntry> all = [] {
    std::vector<PlantEntry> list;
    for (auto part :
         {range_plants, surface_plants, bearing_plants, motion_plants, noise_plants, outside_plants})
      for (PlantEntry& entry : part()) list.push_back(std::move(entry));
    return list;
  }();
  return all;
}

const PlantEntry& entry_of(std::string_view id) {
  for (const PlantEntry& entry : entries())
    if (entry.info.id == id) return entry;
  throw InputError("effect '" + std::string(id) + "' is not one that the physical world can show");
}

}  // namespace

double any_angle(Random& random) { return random.uniform(-std::numbers::pi, std::numbers::pi); }

std::size_t any_landmark(const World& world, Random& random) {
  return static_cast<std::size_t>(random.index(world.landmarks.size()));
}

std::vector<Exposure> first_exposures(const World& world) {
  World once = world;
  once.timing.repeats = 1;
  return expose(once, true_stops(once, no_placing_error(once)));
}

Overview overview(const World& world) {
  Overview out;
  for (const Exposure& exposure : first_exposures(world)) {
    out.distance_m.push_back(exposure.distance_m);
    out.bearing_rad.push_back(exposure.bearing_rad);
    out.range_m.push_back(exposure.range_m);
    out.intensity.push_back(exposure.intensity);
  }
  return out;
}

double quantile(std::vector<double> values, double q) {
  std::sort(values.begin(), values.end());
  const double last = static_cast<double>(values.size() - 1);
  return values[static_cast<std::size_t>(std::lround(std::clamp(q, 0.0, 1.0) * last))];
}

double sector_direction(const World& world, double half_width_rad, double low, double high, Random& random) {
  const std::vector<double> bearings = overview(world).bearing_rad;
  double direction = 0.0;
  for (int draw = 0; draw < 60; ++draw) {
    direction = bearings[static_cast<std::size_t>(random.index(bearings.size()))] + random.uniform(-0.2, 0.2);
    const auto inside = std::count_if(bearings.begin(), bearings.end(), [&](double bearing) {
      return std::abs(wrap_angle(bearing - direction)) < half_width_rad;
    });
    const double share = static_cast<double>(inside) / static_cast<double>(bearings.size());
    if (share >= low && share <= high) break;
  }
  return wrap_angle(direction);
}

const char* to_string(EffectClass effect_class) {
  switch (effect_class) {
    case EffectClass::mean:
      return "mean";
    case EffectClass::noise:
      return "noise";
    case EffectClass::dependence:
      return "dependence";
    case EffectClass::tail:
      return "tail";
    case EffectClass::label:
      return "label";
    case EffectClass::detection:
      return "detection";
    case EffectClass::grid:
      return "grid";
    case EffectClass::absorbed:
      return "absorbed";
  }
  return "";
}

const std::vector<EffectInfo>& effect_table() {
  static const std::vector<EffectInfo> table = [] {
    std::vector<EffectInfo> list;
    for (const PlantEntry& entry : entries()) list.push_back(entry.info);
    return list;
  }();
  return table;
}

const EffectInfo& effect_info(std::string_view id) { return entry_of(id).info; }

World apply(const World& world, std::string_view effect_id, double size, Random& random) {
  const PlantEntry& entry = entry_of(effect_id);
  const EffectInfo& info = entry.info;
  const bool has_sign = info.effect_class == EffectClass::mean || info.effect_class == EffectClass::absorbed;
  if (!std::isfinite(size) || std::abs(size) > info.maximum * (1.0 + 1e-9) || (size < 0.0 && !has_sign))
    throw InputError("size " + std::to_string(size) + " " + info.unit + " of effect '" + info.id +
                     "' is not within its maximum of " + std::to_string(info.maximum));
  World out = world;
  entry.plant(out, size, random);
  out.planted.push_back({info.id, size});
  return out;
}

}  // namespace rangecal::world
