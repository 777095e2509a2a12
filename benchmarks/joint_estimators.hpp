// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal::benchmark {

/// What one method makes of one recording.
struct Estimated {
  bool ok = false, worse_than_seed = false;
  Eigen::VectorXd alpha;
  std::vector<Eigen::Vector2d> landmarks;
  double sigma_e = 0.0, sigma_theta = 0.0;
  std::optional<Eigen::MatrixXd> alpha_covariance;
  Eigen::VectorXd landmark_variance;  ///< empty where the method gives none
};

inline constexpr int order = 2;

inline Estimated from_fit(const JointFit& fit, bool worse) {
  Estimated e;
  e.ok = fit.outcome == Outcome::converged && fit.covariance;
  if (!e.ok) return e;
  e.worse_than_seed = worse;
  e.alpha = fit.state.alpha;
  e.landmarks = fit.state.landmarks;
  e.sigma_e = fit.state.noise.parameters[0];
  e.sigma_theta = fit.state.sigma_theta_rad;
  e.alpha_covariance = fit.covariance->topLeftCorner(e.alpha.size(), e.alpha.size());
  e.landmark_variance = fit.covariance->diagonal().segment(e.alpha.size(), 2 * e.landmarks.size());
  return e;
}

inline Estimated closed_form(const JointProblem& problem, NoiseLaw law) {
  ClosedFormOptions options;
  options.order = order;
  options.noise_law = law;
  const Calibration c = closed_form_calibration(problem, options);
  Estimated e;
  e.ok = c.outcome == Outcome::converged && c.alpha.size() == order + 1 && c.sigma_theta_rad;
  if (!e.ok) return e;
  e.alpha = c.alpha;
  e.sigma_e = c.noise.parameters[0];
  e.sigma_theta = c.sigma_theta_rad->value;
  e.alpha_covariance = c.alpha_covariance;
  e.landmark_variance.resize(2 * c.landmarks.size());
  for (std::size_t l = 0; l < c.landmarks.size(); ++l) {
    e.landmarks.push_back(c.landmarks[l].position_m);
    if (c.landmarks[l].covariance)
      e.landmark_variance.segment<2>(2 * l) = c.landmarks[l].covariance->diagonal();
    else
      e.alpha_covariance.reset();
  }
  return e;
}

inline Estimated full(const JointProblem& problem, NoiseLaw law) {
  const JointFit fit = solve_joint_block(problem, position_seed(problem, order, law));
  return from_fit(fit, fit.joint_nll > fit.start_nll);
}

inline Estimated marginal(const JointProblem& problem, NoiseLaw law) {
  const JointState seed = position_seed(problem, order, law);
  const JointFit full = solve_joint_block(problem, seed);
  const MarginalFit fit = solve_marginal(problem, full.outcome == Outcome::converged ? full.state : seed);
  const LaplaceValue at_seed = laplace_marginal(problem, seed);
  return from_fit(fit, at_seed.ok && fit.marginal_nll > at_seed.marginal_nll);
}

}  // namespace rangecal::benchmark
