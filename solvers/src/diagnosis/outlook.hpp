// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnosis/generic.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// The smooth model of an unexplained mismatch, entered into `result`; none where there is nothing to model.
std::optional<GenericModel> add_generic(const Rows& rows, const SearchResult& found, Diagnosis& result);

/// Cross-validated predictive densities of baseline and final model, by blocks (docs/diagnosis.md).
/// `completed`: the fit that is shown for `unexplained` (with a smooth model, or a partial name alone), or
/// null.
void add_held_out(const Rows& rows, const SearchResult& found, const Fit* completed, Diagnosis& result);

/// Twins, unseen effects with their harm, and the next experiments.
void add_outlook(const Rows& rows, const SearchResult& found, const DiagnoseOptions& options,
                 Diagnosis& result);

}  // namespace rangecal::diagnosis
