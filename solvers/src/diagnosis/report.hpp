// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// What the user reads, from what the search found.
Diagnosis assemble_report(const Rows& rows, std::span<const Recording> recordings, const SearchResult& found);

/// Labels of the landmarks, recording by recording, as the problem's indices count them.
std::vector<std::string> landmark_labels(std::span<const Recording> recordings);

/// A calibration (seed model's or corrected) from a fit, with what `calibrate` says of one: both likelihoods, AIC,
/// covariances and the weakest direction. AIC counts the effects' free parameters too; there is none beside a
/// simulation's curve. Covariances are those at the effects' parameters, whose own errors are not in them.
Calibration calibration_of(const Rows& rows, std::span<const Recording> recordings, const Fit& fit);

}  // namespace rangecal::diagnosis
