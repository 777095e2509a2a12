// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// What the user reads, from what the search found.
Diagnosis assemble_report(const Rows& rows, std::span<const Recording> recordings, const SearchResult& found);

/// A calibration (seed model's or corrected) from a fit.
Calibration calibration_of(const Rows& rows, std::span<const Recording> recordings, const Fit& fit);

}  // namespace rangecal::diagnosis
