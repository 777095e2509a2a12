// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "diagnosis/search.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// What a search found, with all that is said beside it: what the recording leaves open of the curve, the smooth curve
/// where no name answers, places, held-out densities, what could be hidden, what to record next, the simulation.
/// A curve that is open gets no name beside it, and a name that held-out readings speak against is withdrawn: `found`
/// is then what is left. recordings: as they were read; corrected: with the labels that `rows` were made of.
Diagnosis diagnosis_of(const Rows& rows, std::span<const Recording> recordings,
                       std::span<const Recording> corrected, SearchResult& found,
                       const DiagnoseOptions& options);

}  // namespace rangecal::diagnosis
