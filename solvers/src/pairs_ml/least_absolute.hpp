// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pairs_newton.hpp"

namespace rangecal::pairs_ml {

/// Makes every spread `factor` times as large, in an x laid out as in ScaledPairs, its noise parameters from `first` on.
void scale_noise(Vector& x, int first, NoiseLaw law, double factor);

/// The fit of least absolute deviations, in metres (`relative_to` constant) or relative to d^2 (d_squared), by reweighted least
/// squares; the noise from the median deviation. Returns x in the layout of ScaledPairs, of the size of `gaussian`, the x of the
/// Gaussian fit. Empty if f leaves the domain of the law.
Vector least_absolute(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law,
                      NoiseLaw relative_to, const Vector& gaussian);

}  // namespace rangecal::pairs_ml
