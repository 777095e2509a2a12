// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/solvers/correction/correct.hpp"

namespace rangecal {

/// Distances [m] among which a reading's are sought.
struct SearchedRange {
  double low = 0.0, high = 0.0;
  double width() const { return high - low; }
};

/// Throws InputError for a reading that is not finite and positive, and for a calibration that cannot correct
/// one.
SearchedRange searched_range(const Calibration& calibration, double reading_m,
                             const CorrectionOptions& options);

/// Index of the root of highest likelihood, the first of equals; -1 where there is none.
int most_likely(const std::vector<CorrectionRoot>& roots);

}  // namespace rangecal
