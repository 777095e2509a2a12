// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/world/scene.hpp"

namespace rangecal {

/// Stops of a scene or a study's grid: what is more is a mistake in a file.
constexpr int most_scene_stops = 1'000'000;

/// Throws InputError for a scene of more than 1e6 stops, 1e4 random landmarks or 1e8 readings: what no memory
/// holds is a mistake in a file.
void check_size(const Scene& scene);

}  // namespace rangecal
