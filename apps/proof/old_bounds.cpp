// SPDX-License-Identifier: BSD-3-Clause
#include "old_bounds.hpp"

#include <algorithm>
#include <cmath>
#include <map>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/plants.hpp"

namespace rangecal::proof {

/// `git show b621615:problems/effects/ID.cpp`, the limits of EffectInfo::parameters. A tilt's were those of its square's cosine
/// and sine, 0.0305 rad^2; sweep_motion's 0.3 m in a sweep of 0.2 s; an amplitude stands for a cosine and a sine that had
/// one bound each.
std::vector<OldBound> old_bounds(const std::string& id) {
  static const std::map<std::string, std::vector<OldBound>> all{
      {"lens_distortion", {{"inverse_m2", 0.02}}},
      {"pixel_locking", {{"amplitude_per_m", 0.02}}},
      {"near_regime", {{"offset_m", 0.05}}},
      {"tilt", {{"angle_rad", 0.174642, 2}}},
      {"warmup_drift", {{"offset_m", 0.05}, {"curvature_per_m", 0.02}}},
      {"range_eccentricity", {{"amplitude_m", 0.05}}},
      {"cyclic_error", {{"amplitude_m", 0.05}}},
      {"arc_definition", {{"kappa", 0.3}}},
      {"radius_scale", {{"scale", 0.3}}},
      {"target_reflectance", {{"amplitude_m", 0.05}}},
      {"landmark_shape", {{"out_of_round", 0.3}}},
      {"landmark_radius", {{"error_m", 0.05}}},
      {"bearing_offset", {{"angle_rad", 0.0873}}},
      {"bearing_drift", {{"angle_rad", 0.0524}}},
      {"beam_offset", {{"offset_m", 0.05}, {"squint_rad", 0.15}}},
      {"encoder_eccentricity", {{"amplitude_rad", 0.0524}}},
      {"encoder_ellipticity", {{"amplitude_rad", 0.0524}}},
      {"bearing_scale", {{"scale", 0.03}}},
      {"sweep_motion", {{"speed_mps", 1.5}}},
      {"settling", {{"amplitude_rad", 0.0873}}},
      {"path_curvature", {{"curvature_per_m", 0.2}}},
      {"heading_drift", {{"angle_rad", 0.0524}}},
      {"lever_arm", {{"x_m", 0.3}, {"y_m", 0.3}}},
      {"wheel_slip", {{"distance_m", 0.3}}},
      {"moved_landmark", {{"x_m", 0.2}, {"y_m", 0.2}}}};
  const auto found = all.find(id);
  return found != all.end() ? found->second : std::vector<OldBound>{};
}

double in_old_bounds(const world::World& planted, const std::string& id) {
  double squares = 0.0;
  for (const OldBound& old : old_bounds(id)) {
    const auto value = planted.truth.find(id + "." + old.parameter);
    if (value == planted.truth.end())
      throw InputError("the world says nothing of " + id + "." + old.parameter);
    squares += std::pow(std::abs(value->second) / old.bound, 2 * old.power);
  }
  return std::sqrt(squares);
}

double most_old_bounds(const world::World& clean, const std::string& id, std::uint64_t effect_seed) {
  if (old_bounds(id).empty()) return 0.0;
  Random random(effect_seed);
  return in_old_bounds(world::apply(clean, id, world::effect_info(id).maximum, random), id);
}

double size_at_old_bounds(const world::World& clean, const std::string& id, std::uint64_t effect_seed,
                          double times) {
  const double share = std::min(1.0, times / most_old_bounds(clean, id, effect_seed));
  return world::effect_info(id).maximum * std::pow(share, 1.0 / old_bounds(id).front().power);
}

}  // namespace rangecal::proof
