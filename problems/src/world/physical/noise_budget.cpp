// SPDX-License-Identifier: BSD-3-Clause
#include "noise_budget.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace rangecal::world {

double range_sd_m(const World& world, const Cylinder& landmark, double distance_m, double range_m,
                  double ambient_ratio, double time_s) {
  const NoiseBudget& noise = world.noise;
  const double fixed = noise.speckle_per_m * range_m * range_m;
  double variance = fixed * fixed + noise.floor_m * noise.floor_m;
  if (noise.shot_photons > 0.0) {
    // Centroid of S photons of a spot of width w: w / sqrt(S); with B more spread over a window W: sqrt(B/12)
    // W / S.
    const double signal = noise.shot_photons / (distance_m * distance_m);
    const double background = std::sqrt(noise.background_photons / 12.0) * noise.window_px / signal;
    const double centroid_px_sq = noise.spot_px * noise.spot_px / signal + background * background;
    const double m_per_px = 1e3 * distance_m * distance_m * world.sensor.pitch_mm /
                            (world.sensor.focal_mm * world.sensor.baseline_mm);
    variance += m_per_px * m_per_px * centroid_px_sq;
  }
  if (ambient_ratio > 0.0) {
    const double widths = world.ambient.window_px / world.ambient.spot_px;
    variance *= 1.0 + ambient_ratio * widths * widths / 12.0;
  }
  if (landmark.dark_reflectance > 0.0) variance *= landmark.reflectance / landmark.dark_reflectance;
  const UncataloguedEffects& odd = world.uncatalogued;
  double sd = std::sqrt(variance);
  if (time_s >= odd.burst_from_s && time_s < odd.burst_to_s) sd *= 1.0 + odd.burst_factor;
  return sd;
}

double clipped_shift_m(const World& world, const Cylinder& landmark, double distance_m, double across_m) {
  // A uniform footprint of half-width w, cut at the edge R: the centroid of what is left moves by (w - (R -
  // |u|)) / 2.
  const double w = world.noise.spot_radius_m;
  const double inside = landmark.radius_m - std::abs(across_m);
  if (!(w > 0.0) || inside >= w) return 0.0;
  const double moved = 0.5 * (w - inside);
  return (across_m > 0.0 ? 1.0 : -1.0) * moved * distance_m / (1e-3 * world.sensor.baseline_mm);
}

Tail tail_of(const World& world, const Cylinder& landmark, const Exposure& exposure) {
  const NoiseBudget& noise = world.noise;
  if (noise.interference_share > 0.0) {
    const double half = noise.interference_window * exposure.range_sd_m;
    return {noise.interference_share, -half, half};
  }
  if (noise.dust_share > 0.0) return {noise.dust_share, -exposure.range_m, 0.0};
  if (noise.grazing_share > 0.0) return {noise.grazing_share, 0.0, noise.wall_behind_m};
  if (noise.spot_radius_m > 0.0) {
    const double share = std::min(1.0, noise.spot_radius_m / landmark.radius_m);
    // a shift that grows evenly from 0 to its value at the edge, on either side
    const double at_edge = std::abs(clipped_shift_m(world, landmark, exposure.distance_m, landmark.radius_m));
    return {share, -at_edge, at_edge};
  }
  return {};
}

}  // namespace rangecal::world
