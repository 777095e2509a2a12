// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Fits exactly the named effects on top of the baseline, whatever the score tests (`first`) say, and makes them
/// the explanation. Throws InputError for a name that is unknown or cannot be fitted to this recording.
void fit_given(const Rows& rows, const std::vector<std::string>& names, const RefitOptions& options,
               SearchResult& result);

}  // namespace rangecal::diagnosis
