// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// Standard deviation of the independent noise of one reading [m].
///   sigma^2 = (c f^2)^2 + sigma_0^2 + (d^2 p / (f s))^2 (w^2 / S + B W^2 / (12 S^2)),  S = photons / d^2
double range_sd_m(const World& world, const Cylinder& landmark, double distance_m, double range_m,
                  double ambient_ratio, double time_s);

/// Range shift [m] of a beam that meets the landmark `across_m` off its middle and is cut by its edge:
/// a spot centroid moved by du inside the scan plane reads as (d / s) du.
double clipped_shift_m(const World& world, const Cylinder& landmark, double distance_m, double across_m);

/// Share of readings with an extra error, which lies evenly between two ends.
struct Tail {
  double share = 0.0, low_m = 0.0, high_m = 0.0;
};
Tail tail_of(const World& world, const Cylinder& landmark, const Exposure& exposure);

}  // namespace rangecal::world
