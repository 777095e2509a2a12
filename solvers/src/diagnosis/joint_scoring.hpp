// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True of models with tails, or with errors that depend on one another along a sequence, of readings at exactly known
/// distances whose errors are independent otherwise: then every reading's slope of the likelihood is known.
bool is_scored_jointly(const Rows& rows, const Model& model, const JointState& state,
                       const RefitOptions& options);

/// Fits curve, noise and all free parameters of effects together by scoring. e_i are the errors of the readings, p_i their laws with standard
/// deviations s_i, g_i = sqrt(w_i) (e_i / s_i - a_i) under the Gaussian that stands for p_i (tail_law.hpp), and u = K g the
/// errors of the one-step predictions along the sequence, in units of their standard deviations r_i (serial_errors.hpp):
///
///   NLL = sum_i (-ln p_i(e_i) - g_i^2 / 2 + u_i^2 / 2 + ln r_i)
///
/// Every reading's slope of this sum is known in alpha, ln sigma, in the parameters of effects and tails, and in those of the sequence;
/// where errors are independent, u = g, and the slopes are those of ln p. Steps are by sum slope slope^T (Berndt, Hall, Hall,
/// Hausman 1974) and what it is found to lack (damped_scoring.hpp); a step costs one pass over the readings. The calibration is solved for
/// at the end: `detail`. False, and nothing done, where the start or that solve is outside of the model's domain.
bool score_jointly(const Rows& rows, const RefitOptions& options, Fit& fit, MarginalFit& detail);

}  // namespace rangecal::diagnosis
