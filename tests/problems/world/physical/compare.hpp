// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::world::test {

/// What a plant changes in the expected readings, next to what the reading looks like without it.
struct Change {
  World planted;
  Expected before, after;
  std::vector<double> range_m, bearing_rad;          ///< after - before
  std::vector<double> distance_m, beam_rad, time_s;  ///< before
  double truth(const std::string& key) const { return planted.truth.at(key); }
  std::size_t size() const { return range_m.size(); }
};

inline Change change_of(const World& world, const std::string& id, double size, std::uint64_t seed = 1) {
  Random random(seed_from(id, {seed}));
  Change change;
  change.planted = apply(world, id, size, random);
  change.before = expected(world);
  change.after = expected(change.planted);
  for (std::size_t i = 0; i < change.before.range_mean_m.size(); ++i) {
    change.range_m.push_back(change.after.range_mean_m[i] - change.before.range_mean_m[i]);
    change.bearing_rad.push_back(
        wrap_angle(change.after.bearing_mean_rad[i] - change.before.bearing_mean_rad[i]));
  }
  change.distance_m = change.before.distance_m;
  change.beam_rad = change.before.bearing_mean_rad;
  change.time_s = change.before.time_s;
  return change;
}

inline double rms(const std::vector<double>& values) {
  double sum = 0.0;
  for (const double value : values) sum += value * value;
  return std::sqrt(sum / static_cast<double>(values.size()));
}

/// rms(values - formula(i)) / rms(formula(i)).
template <typename Formula>
double misfit(const std::vector<double>& values, const Formula& formula) {
  std::vector<double> wanted, off;
  for (std::size_t i = 0; i < values.size(); ++i) {
    wanted.push_back(formula(i));
    off.push_back(values[i] - wanted.back());
  }
  return rms(off) / rms(wanted);
}

/// A world of ideal optics whose range curve is the identity.
inline World plain(World world) {
  world.sensor = OpticalSensor{};
  return world;
}
inline World line() { return plain(make_line_design()); }
inline World turning() { return plain(make_turning_design()); }

}  // namespace rangecal::world::test
