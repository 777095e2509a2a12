// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/rows.hpp"

namespace rangecal::diagnosis {

/// Readings that cells lack of the fullest one's number, cells without any included, and the limit beyond
/// which they are missing. A stop that reads all it sees equally often lasted for that many sweeps. Cells whose landmark stands
/// behind another one, as seen from their stop, are left out: what hides it is known.
struct Gaps {
  double missing = 0.0, expected = 0.0;
  double from_m = 0.0;  ///< mean reading of the nearest cell beyond the limit
  double gain = 0.0;  ///< nats of two rates, below and beyond it, against one, less the price of choosing it
  /// That so many of the cells with gaps lie beyond it if gaps know no distance; the least over the limits
  /// tried.
  double chance = 1.0;
};

Gaps gaps_of(const Rows& rows);

}  // namespace rangecal::diagnosis
