// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <vector>

#include "rangecal/problems/world/scene.hpp"

/// What every simulation of a scene has in common: where everything is, when it is read, and what is reported of it.
namespace rangecal {

/// Where stops and landmarks are, as commanded and in truth, with the distances that were taped; no reading. Stops,
/// landmarks and tapes draw from streams of their own. Throws InputError where there is no stop, or no room for a landmark.
Recording laid_out(const Scene& scene, std::uint64_t seed);

/// Time [s] of the first sweep at each stop (first reading of each batch), 0 at the first; empty without timing.
std::vector<double> start_times_s(const Scene& scene);

/// Leaves of readings that were drawn for a scene those that are reported, with their times, rows and counts: of
/// landmarks that are visible from the true stops, readings within the sensor's limits that are not beyond
/// `lost_beyond_m` [m]; a cell (batch) that loses more than 1 % at a limit of the sensor is left out whole. The readings are
/// all repeats of each cell in order, or of each batch. Throws InputError where the noise has no spread.
void keep_reported(const Scene& scene, double lost_beyond_m, Recording& recording);

}  // namespace rangecal
