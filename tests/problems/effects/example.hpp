// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <numbers>
#include <vector>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects_testing {

/// Six stops on an L-shaped path, three landmarks, 15 repeats, times and columns of intensity, received power, temperature and elevation: nothing
/// is missing but what takes known distances.
inline EffectContext example_context() {
  EffectContext context;
  context.stop_count = 6;
  context.landmark_count = 3;
  context.landmark_labels = {"A", "B", "C"};
  context.landmark_radius_m = {0.12, 0.12, 0.04};
  context.commanded = {{0.0, 0.0, 0.0},
                       {1.0, 0.0, 0.0},
                       {2.0, 0.0, 0.0},
                       {2.0, 0.0, std::numbers::pi / 2},
                       {2.0, 1.0, std::numbers::pi / 2},
                       {2.0, 2.0, std::numbers::pi / 2}};
  context.path_m = {0.0, 1.0, 2.0, 2.0, 3.0, 4.0};
  context.stop_time_s = {0.0, 50.0, 75.0, 98.0, 200.0, 395.0};
  context.duration_s = 400.0;
  context.range_min_m = 0.5;
  context.range_max_m = 4.5;  // geometric middle 1.5
  context.largest_cell = 15.0;
  context.headings = 0.8;
  context.several_radii = true;
  context.largest_bearing_rad = 1.1;
  context.covariates = {"intensity", "rx_power_dbm", "temperature_c", "elevation_rad"};
  context.columns = {{ColumnRole::intensity, 100.0, 10.0},
                     {ColumnRole::received_power, -70.0, 4.0},
                     {ColumnRole::temperature, 25.0, 5.0},
                     {ColumnRole::elevation, 0.2, 0.3}};
  return context;
}

/// The same with known distances in place of stops.
inline EffectContext example_of_pairs() {
  EffectContext context = example_context();
  context.kind = RecordingKind::pairs;
  return context;
}

/// The catalogue as that recording may hold it: of an effect along columns one for each of them, in place of its kind.
inline std::vector<const Effect*> example_effects() { return effects_of(example_context()); }

/// Priors of the stops of that context: 1 cm, 0.3 degrees; the turn in place (stop 3) stays at the place of
/// stop 2.
inline std::vector<StopPrior> example_stops(const EffectContext& context) {
  std::vector<StopPrior> stops;
  for (std::size_t k = 0; k < context.commanded.size(); ++k)
    stops.push_back({.commanded = context.commanded[k],
                     .sigma_xy_m = 0.01,
                     .sigma_heading_rad = 0.005,
                     .place = static_cast<int>(k < 3 ? k : k - 1),
                     .opens_place = k != 3});
  return stops;
}

/// A reading at stop 3 of landmark 1, 2 s after the stop's first: d = 2 m, b = 60 degrees, heading 30
/// degrees, so the direction in the world is 90 degrees; f = 2.1 m, f' = 0.9, f'' = 0.1 / m, spread 2 cm;
/// intensity 120, -74 dBm, 35 degrees Celsius, elevation 30 degrees.
inline ReadingView<double> example_reading(const EffectContext& context) {
  static const double covariates[] = {120.0, -74.0, 35.0, std::numbers::pi / 6};
  ReadingView<double> at{};
  at.d = 2.0;
  at.axis_distance = 2.12;
  at.bearing = std::numbers::pi / 3;
  at.f = 2.1;
  at.slope = 0.9;
  at.curvature = 0.1;
  at.spread = 0.02;
  at.radius = 0.12;
  at.heading = std::numbers::pi / 6;
  at.time_s = 100.0;
  at.time = 0.25;
  at.stop = 3;
  at.landmark = 1;
  at.repeat = 2;
  at.covariate = covariates;
  at.context = &context;
  return at;
}

}  // namespace rangecal::effects_testing
