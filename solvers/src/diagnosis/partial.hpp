// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Looks for a single effect that accounts for one channel while something without a name is left: it must be
/// well seen, by its score too; no change of the mean may explain clearly more; and it must either leave its
/// channel clean and equal a free curve there, or dominate. `root`: what was left before; `batteries`: what
/// the first of `singles` leave; that of the one named goes to `result`.
void find_partial(const Rows& rows, const DiagnoseOptions& options, const Battery& root,
                  const std::vector<Candidate>& singles, std::vector<std::unique_ptr<Battery>>& batteries,
                  SearchResult& result);

}  // namespace rangecal::diagnosis
