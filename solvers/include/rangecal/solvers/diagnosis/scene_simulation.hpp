// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "rangecal/problems/world/scene.hpp"

namespace rangecal {

/// A recording of any scene, with its ground truth: of the seed model and of optics by the simulate() of
/// polynomial_world.hpp, with effects by that of simulation_model.hpp, which draws what a diagnosis explains.
///
/// Effects act at the true parameters of the scene. What is left out of it there:
///   label_swap        the labels of two landmarks are exchanged as they are written
///   dropout           readings beyond the limit are not there, and counted as "lost to dropout"
///   reciprocal_noise  its noise takes the place of the sensor's: s = cv f^2
/// What is reported of it is what the seed model's simulation reports: visibility, limits of the sensor, cut cells.
///
/// The same scene and seed give the same recording; random landmarks and tapes are those of the scene without effects.
/// Throws InputError for more than 1e7 readings with effects, and as those two do. Cost: linear in the readings.
Recording simulate_scene(const Scene& scene, std::uint64_t seed);

}  // namespace rangecal
