// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pairs_newton.hpp"

namespace rangecal::pairs_ml {

/// Makes every spread `factor` times as large: x as ScaledPairs has it, the noise from `first` on.
void scale_noise(Vector& x, int first, NoiseLaw law, double factor);

/// Least absolute deviations, in metres (relative_to constant) or parts of d^2 (d_squared), by reweighted least
/// squares; the noise from the median deviation. x as ScaledPairs has it, of the size of `gaussian`, an x of the same.
/// Empty where f leaves the domain of the law.
Vector least_absolute(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law,
                      NoiseLaw relative_to, const Vector& gaussian);

}  // namespace rangecal::pairs_ml
