// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pairs_newton.hpp"

namespace rangecal::pairs_ml {

/// REML: the noise parameters psi = argmin of [min over c of NLL(c, psi)] + 1/2 log det H_cc, with H_cc the second derivatives
/// in the coefficients c at their conditional optimum (flat prior on c). Starts from the joint optimum `full`; the iteration
/// steps along the gradient, scaled by the inverse of the Schur complement of the expected information.
NewtonResult restricted(const ScaledPairs& pairs, const NewtonResult& full, int max_iterations);

}  // namespace rangecal::pairs_ml
