// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnosis/generic.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// The smooth model of an unexplained mismatch, entered into `result`; none where there is nothing to model.
std::optional<GenericModel> add_generic(const Rows& rows, const SearchResult& found, Diagnosis& result);

/// Cross-validated predictive densities of baseline, final model and all other explanations, by the final model's
/// blocks (docs/diagnosis.md; where several recordings are given and each can be predicted from the others, whole
/// recordings), so that they compare; the standard error is that of the difference to the baseline.
/// `completed`: the fit that is shown for `unexplained` (with a smooth model, or a partial name alone), or
/// null. Cost: that of a refit on four fifths of the readings, from the full fit, for each fold and explanation.
void add_held_out(const Rows& rows, const SearchResult& found, const Fit* completed, Diagnosis& result);

/// Held-out NLL of a fit less that of the baseline [nats], by the fit's own blocks.
struct HeldOutChange {
  double nll = 0.0;
  std::optional<double> std_dev;
};
/// None where a training part cannot be fitted.
std::optional<HeldOutChange> held_out_change(const Rows& rows, const SearchResult& found, const Fit& fit);
/// The same less that of another fit.
std::optional<HeldOutChange> held_out_change(const Rows& rows, const SearchResult& found, const Fit& other,
                                             const Fit& fit);

}  // namespace rangecal::diagnosis
