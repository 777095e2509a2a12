// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/search.hpp"
#include "diagnosis/unseen.hpp"

namespace rangecal::diagnosis {

/// The changes of the experiment that settle what this recording leaves open, each computed on this very
/// recording extended by it.
///
/// Where several models explain the mismatch: with x_A the change that A makes at its fitted size in the
/// extended design, and B free to refit, lambda = |x_A|^2 after taking out the calibration and B's
/// parameters. Twice the log likelihood ratio of A to B is N(lambda, 4 lambda); `power` is the probability
/// that it exceeds twice `gap_nats` for the closest pair. Pairs that no change separates are exact twins and
/// count as one. Otherwise: the unseen effects that become visible, weighted by the range errors that they cause; `power` is
/// their probability of detection weighted by the range errors. Effects that this recording cannot hold for want of
/// times, targets or repeats count as unseen, with the range error that they cause in the extended recording.
///
/// Sets explanations[0].separated_by where it names a set.
void add_next_experiments(const Space& space, const SearchResult& found, const DiagnoseOptions& options,
                          const JointState& state, const std::vector<TypicalEffect>& effects,
                          Diagnosis& result);

}  // namespace rangecal::diagnosis
