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

/// The same where the errors of the readings, one a cell, depend on one another along a sequence: with z the residuals in
/// units of their spreads, log s = tau + g(f, d), and u = K z (SerialErrors),
///   NLL = n tau + sum g_i + u^T u / 2 + constants [nats];
/// Fisher scoring in alpha and the REML update of tau in turn. The determinant of the sequence is left to the caller. Fails
/// for a polynomial noise law.
MarginalFit solve_with_serial_errors(const JointProblem& problem, const SerialErrors& serial,
                                     const JointState& start, const Held& held);

}  // namespace rangecal::diagnosis
