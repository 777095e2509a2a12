// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/draft_design.hpp"

namespace rangecal::diagnosis {

/// What can be changed where distances are known: their order, number and span, repeats, targets, directions,
/// temperature, days. Cheapest first.
std::vector<MenuEntry> menu_for_pairs(const Rows& rows);

/// Adds the pairs that the change brings to a draft of `rows`, and says in `design` what else it changes. Distances at
/// which the fitted curve cannot be read, not positive or falling, are left out. Throws std::invalid_argument for a
/// code that is not on the menu.
void extend_pairs(const Rows& rows, const std::string& code, DraftDesign& draft, ExtendedDesign& design);

}  // namespace rangecal::diagnosis
