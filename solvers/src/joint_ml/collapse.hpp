// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/core.h>

#include <string>

#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {

/// The sigma that fell below collapse_ratio of its start, in words; empty if none did.
inline std::string collapsed_sigma(const JointState& start, const JointState& now) {
  if (now.sigma_theta_rad < collapse_ratio * start.sigma_theta_rad)
    return fmt::format("sigma_theta went to 0 ({:.1e} rad and falling)", now.sigma_theta_rad);
  if (has_sigma(now.noise.law) && now.noise.parameters[0] < collapse_ratio * start.noise.parameters[0])
    return fmt::format("sigma_e went to 0 ({:.1e} and falling)", now.noise.parameters[0]);
  return {};
}

/// Why the joint likelihood has no maximum whatever the readings say: at every place one channel has no more cells
/// than free coordinates that act on it, and nothing repeats, so that its residuals can all be zeroed and its sigma
/// goes to 0 (L <= 2; L <= 3 bearings with a free heading). Names both sigmas where either can go. Empty if that is not so.
std::string unbounded_channel(const JointProblem& problem, const Held& held);

/// True, with outcome and reason in `fit`, where a solve has nothing to do: fit.start_nll is not finite, or the joint
/// likelihood has no maximum. Where either sigma can go to 0 the reason names the one that leads further down from
/// fit.state: each is held at a thousandth of its start, all else brought to its optimum, and the likelihoods compared.
bool cannot_start(const JointProblem& problem, const Held& held, JointFit& fit);

}  // namespace rangecal
