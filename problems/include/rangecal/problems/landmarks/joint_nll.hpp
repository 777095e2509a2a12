// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// The joint negative log-likelihood of all unknowns (docs/equations.md, "The two likelihoods"), constants included:
///
///   -log p = sum_range   [ log s_i + (y_i - f(d_i))^2 / (2 s_i^2) + log(2 pi)/2 ]
///          + sum_bearing [ log sigma_theta + wrap(b_i - theta_i)^2 / (2 sigma_theta^2) + log(2 pi)/2 ]
///          + sum_stops   [ e^T C^-1 e / 2 + log det(2 pi C) / 2 ],  e = (p - p_commanded, wrap(h - h_commanded))
///          + sum_taped   [ (|m_a - m_b| - t)^2 / (2 sigma_t^2) + log sigma_t + log(2 pi)/2 ]
///
/// d_i = |m_l - p_k| - radius_l [m], theta_i = atan2(m_l - p_k) - h_k [rad], s_i the noise law at d_i [m].
/// C = diag(sigma_s^2, sigma_s^2, sigma_h^2) or the stop's own covariance (stop_prior.hpp), over what is not exact: the position
/// where the stop opens its place, the heading where sigma_h > 0. Random walk: the priors act on the increment from the stop before, seen in that stop's frame, in place of the
/// error itself; the first stop keeps the prior on its own error.
///
/// Returns [nats]; +infinity where a distance, a spread or a sigma is not positive. Cost: linear in the cells.
double joint_nll(const JointProblem& problem, const JointState& state);

/// Log-likelihood parts of joint_nll, for reports and tests.
struct JointNllParts {
  double range = 0.0, bearing = 0.0, stops = 0.0, taped = 0.0;
  double total() const { return range + bearing + stops + taped; }
};
JointNllParts joint_nll_parts(const JointProblem& problem, const JointState& state);

}  // namespace rangecal
