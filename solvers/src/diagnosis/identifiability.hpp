// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Adds what the design can and cannot identify: twins, unseen effects with the range error that they cause, and the next
/// experiments.
void add_identifiability(const Rows& rows, const SearchResult& found, const DiagnoseOptions& options,
                         Diagnosis& result);

}  // namespace rangecal::diagnosis
