// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "diagnosis/rows.hpp"

namespace rangecal::diagnosis {

/// What to record next to settle whether the effect is there, in words that fit the recording: of stops and landmarks the
/// catalogue's. Of pairs the change of their menu (`menu_for_pairs`) that asks it, where the menu offers it, else words for
/// targets at known distances; of an effect that has none, the catalogue's.
std::string settled_by(const Rows& rows, const Effect& effect);

}  // namespace rangecal::diagnosis
