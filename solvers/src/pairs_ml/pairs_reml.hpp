// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "pairs_newton.hpp"

namespace rangecal::pairs_ml {

/// REML: psi = argmin of [min over c of NLL(c, psi)] + 1/2 log det H_cc, H_cc the second derivatives in the
/// coefficients at their conditional optimum (flat prior on them), from the joint optimum `full`. Fixed point on the
/// gradient with the Schur complement of the expected information as metric.
NewtonResult restricted(const ScaledPairs& pairs, const NewtonResult& full, int max_iterations);

}  // namespace rangecal::pairs_ml
