// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>

#include "diagnosis/refit.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::diagnosis {

/// Why a recording does not determine the calibration, and the direction that is unobservable.
struct Undetermined {
  std::string what, weakest_direction;
};

/// As `calibrate` decides it, by its own functions, at a fit: of landmarks a singular covariance or unobservable_reason
/// (calibrate/observability.hpp); of pairs the outcome of the marginal fit of the curve's order, a line at least.
/// A curve without a slope is asked as a line through its value. None where the curve is determined.
/// Cost: linear in the readings.
std::optional<Undetermined> undetermined(const Rows& rows, std::span<const Recording> recordings,
                                         const Fit& fit);

/// Gives a calibration of the recordings the outcome `unobservable`, its standard deviations removed.
void mark_undetermined(const Rows& rows, const Undetermined& open, const Fit& fit, Calibration& calibration);

}  // namespace rangecal::diagnosis
