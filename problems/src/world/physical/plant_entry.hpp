// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::world {

/// An effect and how it changes the world.
struct PlantEntry {
  EffectInfo info;
  void (*plant)(World& world, double size, Random& random);
};

std::vector<PlantEntry> range_plants();
std::vector<PlantEntry> surface_plants();
std::vector<PlantEntry> bearing_plants();
std::vector<PlantEntry> motion_plants();
std::vector<PlantEntry> noise_plants();
std::vector<PlantEntry> outside_plants();

/// Any direction [rad].
double any_angle(Random& random);
/// Index of any landmark.
std::size_t any_landmark(const World& world, Random& random);
/// The first reading of each landmark from each stop, as commanded and without noise.
std::vector<Exposure> first_exposures(const World& world);
/// Of the same: distances, bearings and intensities.
struct Overview {
  std::vector<double> distance_m, bearing_rad, range_m, intensity;
};
Overview overview(const World& world);
/// The q-quantile of some values.
double quantile(std::vector<double> values, double q);
/// A direction such that a sector of that half-width around it holds between `low` and `high` of the
/// readings, if one is found in a few draws.
double sector_direction(const World& world, double half_width_rad, double low, double high, Random& random);

}  // namespace rangecal::world
