// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True of models with tails, or with errors that depend on one another along a sequence, of readings at exactly known
/// distances whose errors are independent otherwise: then every reading's slope of the likelihood is known.
bool is_scored_jointly(const Rows& rows, const Model& model, const JointState& state,
                       const RefitOptions& options);

/// Fits curve, noise and all free parameters of effects together by scoring, those of the sequence in turn with the others. With z_i = e_i / s_i under
/// the weights that tails give, V their correlation, pull = V^-1 z, and r_i the squares that are expected of reading i,
///
///   slope in a mean:         g_i = pull_i (df_i/da) / s_i
///   slope in a log spread:   g_i = (r_i - 1) d ln s_i / da          r_i = z_i pull_i + its tail's variance
///   slope in u = ln p of a tail:  g_i = d ln p(e_i) / du
/// with steps by the information I (damped_scoring.hpp). I is Fisher's information; beside tails sum g_i g_i^T (Berndt, Hall, Hall, Hausman 1974), along a sequence with the slopes in
/// means rescaled to Fisher's own information on them, to which single readings do not add up. A step costs one pass over the readings. The calibration is solved for at the end: `detail`. False, and nothing done, where the start or that solve is
/// outside of the model's domain.
bool score_jointly(const Rows& rows, const RefitOptions& options, Fit& fit, MarginalFit& detail);

}  // namespace rangecal::diagnosis
