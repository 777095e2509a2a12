// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// What true distances that are known to sigma [m] (Recording::reference) add to the covariance of alpha.
///
/// The readings of one setting s, at one stated distance d of one batch, share its error delta_s ~ N(0, sigma^2): a reading is
/// off by f'(d) delta_s. Weighted least squares, of which the likelihood is one to first order, moves by
///
///   A^-1 sum_s (sum_i g_i) delta_s,   g_i = w_i f'(d_i) phi(d_i),   w_i = 1 / s(d_i)^2,   phi = (1, u, u^2, ...)
///
/// with A^-1 the covariance by the model. What of it is independent from reading to reading the noise law has taken up
/// already, so that
///
///   cov alpha += A^-1 [ sum_s sigma_s^2 ((sum_i g_i)(sum_i g_i)^T - sum_i g_i g_i^T) ] A^-1
///
/// which adds nothing where every reading has a distance of its own. Source: ours, by propagation of errors. The words are
/// for a person; none, and nothing changed, where all distances are exact.
std::optional<std::string> add_reference_error(std::span<const Recording> recordings,
                                               Calibration& calibration);

}  // namespace rangecal
