// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True of models with tails, or with errors that depend on one another along a sequence, of readings at exactly known
/// distances whose errors are independent otherwise, on a grid if each is alone in its cell: then every reading's slope of the
/// likelihood is known.
bool is_scored_jointly(const Rows& rows, const Model& model, const JointState& state,
                       const RefitOptions& options);

/// Fits curve, noise and all free parameters of effects together, those of the sequence too, by scoring. e_i are the errors of the
/// readings, p_i their laws with standard deviations s_i. Where they are independent the slopes are those of ln p_i(e_i). Along a
/// sequence u = K z are the errors of the one-step predictions, in units of their standard deviations r_i (serial_errors.hpp), and
/// the slopes those of
///
///   -u_i^2 / 2 - ln r_i - ln s_i,   z_i = e_i / s_i;
///
/// beside tails those of the density of e_i given the readings before it (wandering_part.hpp). Steps are by sum slope slope^T (Berndt,
/// Hall, Hall, Hausman 1974) and what it is found to lack (damped_scoring.hpp); a step costs one pass over the readings. The
/// calibration is solved for at the end: `detail`. False, and nothing done, where the start or that solve is outside of the model's
/// domain.
bool score_jointly(const Rows& rows, const RefitOptions& options, Fit& fit, MarginalFit& detail);

}  // namespace rangecal::diagnosis
