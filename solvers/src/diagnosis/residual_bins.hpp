// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Fills Finding::residuals of a diagnosis: the readings' residuals in the finding's channel, averaged over
/// 12 bins of equal shares along its covariate (one bin per group where it has few values), under the
/// baseline and under the final model: mean residual [m] or [rad], or for a noise channel the log ratio of
/// its variance to the modelled one. `generic`: the fit of the smooth model for `unexplained`; null if there
/// is none. Channels without a covariate (labels, grids, detection, stops) get no bins. Cost: n log n in the
/// readings, per finding.
void add_residual_bins(const Rows& rows, const SearchResult& found, const Fit* generic, Diagnosis& result);

}  // namespace rangecal::diagnosis
