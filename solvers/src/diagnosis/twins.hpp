// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/signatures.hpp"

namespace rangecal::diagnosis {

/// Noncentrality at which a test of one degree of freedom among `questions` finds an effect with probability
/// 0.8 while the whole battery raises an alarm at `rate`: (z_c + z_0.8)^2, z_c the two-sided normal limit at
/// 1 - (1-rate)^(1/questions).
double detection_threshold(double rate, double questions);
/// Probability that a noncentral chi-square of one degree of freedom exceeds the limit of that test.
double detection_power(double noncentrality, double rate, double questions);

/// Sets that no reading of this recording can tell apart: effects that the calibration's own unknowns absorb,
/// with those that take more than a fifth of the signature; and effects whose projected signatures have
/// |cosine| > 0.999.
std::vector<std::vector<std::string>> find_twins(const Space& space,
                                                 const std::vector<TypicalEffect>& effects);

}  // namespace rangecal::diagnosis
