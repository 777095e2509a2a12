// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/projector.hpp"
#include "diagnosis/refit.hpp"
#include "diagnosis/select/priors.hpp"

namespace rangecal::diagnosis {

/// What the likelihood gains where no formula of a name is exact [nats], at most what its shape leaves in the readings. With u the change
/// of the mean readings by a member after the first `known`, x the covariate of its law (the range where that is none with values in an
/// order), the change of reading i becomes
///
///   u_i (1 + sum_j c_j g_j(x_i)),   c_j ~ N(0, (tau r_j)^2 / J)
///
///   g_j  Legendre polynomials of orders 1 to J = 3 over the values of x; of an angle cosine and sine of 1 to 3 times x, J = 6
///   r_j  |u| / |g_j u|, u taken out of g_j u and both in standard deviations of the readings: the change of shape is tau |u|
///   gain = 1/2 b^T (C^-1 + I)^-1 b - 1/2 ln |1 + C I|,   ln (1 - w + w exp(gain)) in all
///
/// b, I slope and information of all c at the fit, calibration and parameters of the members integrated out; C their prior; w, tau
/// of SelectionPriors. Curves without a name have no formula; names that jump at a distance get no such allowance, for a jump elsewhere would
/// pass for an error of shape.
double log_formula_allowance(const Rows& rows, const Projector& projector, const Fit& fit, std::size_t known,
                             const SelectionPriors& priors);

}  // namespace rangecal::diagnosis
