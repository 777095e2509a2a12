// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::proof {

/// A clean world of a design that nobody planned: 3 to 12 landmarks, 5 to 60 stops, 1 to 30 repeats, each number with equal
/// chance; a path that is straight (1 to 5 m), an arc (1.5 to 5 m, by 30 to 270 degrees) or random within 3.5 m x 3.5 m
/// (steps of 0.1 to 0.8 m, turns on the way and at the stop), with equal chance. Landmarks of 4, 8 or 12 cm lie within 1.5 m of
/// the path's rectangle, 0.35 m or more from every stop and 0.1 m from each other. Positions are as exact as stated, 2 to
/// 20 mm, headings exact or known to 0.1 to 0.5 degrees; each of the columns intensity and temperature_c in
/// half of the worlds. The sensor as world::vary has it.
world::World any_design(Random& random);

}  // namespace rangecal::proof
