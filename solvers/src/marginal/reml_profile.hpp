// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>

#include "marginal/marginal_likelihood.hpp"

namespace rangecal {

/// The REML criterion l_s + 1/2 log det A as a function of one sigma, minimised over everything else. In `options` the other
/// sigmas are free. Each minimisation starts where the last one ended; +infinity if it finds no optimum.
class RemlProfile {
 public:
  RemlProfile(const JointProblem& problem, JointState state, MarginalOptions options, Sigma which)
      : problem_(problem), state_(std::move(state)), options_(options), which_(which) {
    if (which == Sigma::stops)
      options_.estimate_sigma_s = false;
    else
      options_.held_sigma = which;
  }

  double operator()(double sigma) {
    JointState at = state_;
    (which_ == Sigma::stops   ? at.sigma_s_m.emplace()
     : which_ == Sigma::theta ? at.sigma_theta_rad
                              : at.noise.parameters[0]) = sigma;
    Marginal marginal(problem_, at, options_);
    const Held& held = options_.held;
    const SolverLog log("reml profile");
    if (!std::isfinite(marginal.value(at)) ||
        !marginal.minimise(at, held, 1e-5, Marginal::renewal_for(options_), log)) {
      log.end(marginal.iterations, not_known, marginal.gradient_norm, Outcome::not_converged);
      return std::numeric_limits<double>::infinity();
    }
    const double value = marginal.marginal_nll + marginal.half_log_det_phi(held);
    log.end(marginal.iterations, value, marginal.gradient_norm, Outcome::converged);
    if (std::isfinite(value)) state_ = at;
    return value;
  }
  const JointState& state() const { return state_; }

 private:
  const JointProblem& problem_;
  JointState state_;
  MarginalOptions options_;
  Sigma which_;
};

}  // namespace rangecal
