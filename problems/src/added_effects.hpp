// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal {

/// Makes an effect known beside the catalogue's, for the rest of the program. Its id is not known yet.
void add_effect(std::unique_ptr<Effect> effect);
/// Those that were added, in order.
std::vector<const Effect*> added_effects();

}  // namespace rangecal
