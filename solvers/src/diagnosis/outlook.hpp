// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Cross-validated predictive densities of baseline and final model, by blocks (FORMAT).
void add_held_out(const Rows& rows, const SearchResult& found, const DiagnoseOptions& options, Diagnosis& result);

/// Twins, unseen effects with their harm, and the next experiments.
void add_outlook(const Rows& rows, const SearchResult& found, const DiagnoseOptions& options, Diagnosis& result);

}  // namespace rangecal::diagnosis
