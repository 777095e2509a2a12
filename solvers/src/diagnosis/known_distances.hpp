// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnosis/rows.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal::diagnosis {

/// `marginal` of pairs, whose distances stand: what solve_marginal (marginal/marginal.hpp) finds with the landmark held, by
/// one pass over the cells per evaluation and no blocks of stops (pairs_ml/pairs_reml.hpp). None for a polynomial noise
/// law, and where it has no optimum within its iterations: solve_marginal then tells why.
/// problem: that of pairs as `make_rows` lays them out, with means and weights under a model; start: alpha and noise.
/// Cost: some 40 passes of about 1 ns per cell.
std::optional<MarginalFit> solve_at_known_distances(const JointProblem& problem, const JointState& start);

}  // namespace rangecal::diagnosis
