// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// The 2021 experiment: 20 stops on a straight line at constant heading, five cylinders of 12 cm, 15 repeats.
World make_line_design();

/// A loop with turns: 24 stops at 11 places, some turned on the spot, six cylinders of 4, 8 and 12 cm, 10
/// repeats, columns intensity and temperature_c, headings known to 0.3 degrees.
World make_turning_design();

/// Another unit of the same design: landmarks shifted by up to 10 cm, other sensor constants (zero +-5 mm,
/// scale
/// +-0.5 %, pointing +-0.15 mrad), noise 0.002 to 0.006 f^2, bearings 0.4 to 0.6 degrees, other reflectances.
World vary(const World& world, Random& random);

}  // namespace rangecal::world
