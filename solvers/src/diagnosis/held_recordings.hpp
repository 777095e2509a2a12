// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "diagnosis/rates.hpp"
#include "diagnosis/subset.hpp"
#include "diagnosis/training_part.hpp"

namespace rangecal::diagnosis {

/// Recordings of the job that have readings.
int recordings_with_readings(const Rows& rows);

/// Why whole recordings cannot be held out for a model, in words: an effect that belongs to one recording (labels, one
/// landmark or stop, the course of a run's time), or recordings whose distances the others do not cover; empty where
/// they can.
std::string why_not_whole_recordings(const Rows& rows, const Model& model);

/// Negative log density of readings whose stops s and landmarks m are not known, at theta = (alpha, noise, effects) of
/// `model` and `state` [nats]:
///   -log int int p(y | s, m; theta) p(s) ds dm,
/// by Laplace's method for both: min over m of l_s + 1/2 log det A - L log(2 pi), A = d2 l_s / dm2, L landmarks. The
/// prior of m is flat, 1 per square metre, in every model, so that differences between models are well defined; the
/// value itself depends on the metre. Pairs have no such unknowns. `rows` without a prior of alpha; `state` moves to
/// the optimum. NaN where there is none. Source: as of the marginal likelihood (docs/equations.md).
double predictive_nll(const Rows& rows, const Model& model, JointState& state);

/// That of each recording under the model fitted to the others, summed; five folds of recordings at most. `parts`: of
/// fewer than eight recordings, parts of each (made of its blocks), given the rest of it; of more, the recordings. Not ok where a training part does not determine the calibration.
HeldOut predict_recordings(const Rows& rows, const Fit& full, const Rates& rates,
                           const RefitOptions& options);

/// What was left out, and what the standard error is of, in words.
std::string whole_recordings_in_words(const Rows& rows);

}  // namespace rangecal::diagnosis
