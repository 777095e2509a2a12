// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/extended_design.hpp"
#include "diagnosis/search.hpp"
#include "diagnosis/unseen.hpp"

namespace rangecal::diagnosis {

/// A change of the menu and this recording extended by it.
struct PossibleChange {
  MenuEntry entry;
  ExtendedDesign design;
};

/// Appends to result.next_experiments the changes of `menu` that bring effects of result.unseen to light, those first that
/// detect the largest range errors [m] beyond what this recording detects; changes that are listed already stay where they are.
/// `here` is this recording under its estimate, `effects` the catalogue at typical size there. `power` is the
/// probability of detection weighted by the range errors. Of pairs, effects that a change lets one ask at all count as
/// unseen; where landmarks have radii a calliper (0.2 mm) is one more change.
void reveal_unseen(const std::vector<PossibleChange>& menu, const SearchResult& found,
                   const DiagnoseOptions& options, const Space& here,
                   const std::vector<TypicalEffect>& effects, Diagnosis& result);

}  // namespace rangecal::diagnosis
