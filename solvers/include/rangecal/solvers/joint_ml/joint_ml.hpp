// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>

#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Which of the globals stay where they are.
struct Held {
  bool alpha = false;   ///< the polynomial f
  bool sigmas = false;  ///< noise, sigma_theta and sigma_s
  bool landmarks = false;
};

struct JointOptions {
  int max_iterations = 200;
  double gradient_tolerance = 1e-7;  ///< norm of the gradient in Fisher-scaled units at which the solve ends
  Held held;
};

/// Where a solve of the joint or the marginal likelihood ended.
struct JointFit {
  JointState state;
  Outcome outcome = Outcome::failed;
  std::string reason;
  double start_nll = 0.0;      ///< joint NLL of the start [nats]
  double joint_nll = 0.0;      ///< at `state` [nats]
  double gradient_norm = 0.0;  ///< sqrt(g^T H^-1 g) at the last evaluation
  int iterations = 0, evaluations = 0;
  /// Covariance of the globals (layout of JointLayout), stops marginalised; absent where rank-deficient.
  std::optional<Eigen::MatrixXd> covariance;
  std::string covariance_reason;
  std::string weakest_direction;
};

/// `full`: minimises the joint NLL over alpha, noise, sigma_theta, stops and landmarks together, by a damped Newton
/// method whose stops are eliminated node by node (Schur complement): Fisher scoring far away, exact second
/// derivatives near the optimum. sigma_s must be given. Ends as `unbounded`, naming the sigma, where the likelihood
/// has no maximum. Cost: linear in the cells per iteration.
JointFit solve_joint_block(const JointProblem& problem, const JointState& start,
                           const JointOptions& options = {});

/// A start from the readings alone: each landmark at the mean of stop + (y + radius) (cos, sin) over its cells (no
/// geometry ruins it), alpha by least squares weighted with 1/d^4, sigmas from the residuals; stops as commanded.
/// Where a commanded stop stands inside a landmark that it sees (odometry that has drifted), stops and landmarks are
/// those of the joint maximum of the distances to the axes instead.
JointState position_seed(const JointProblem& problem, int order, NoiseLaw law);

/// alpha, noise and sigma_theta that go with given landmarks and stops: least squares weighted with 1/d^4, then
/// moments of the residuals. Throws InputError if there are fewer cells than coefficients.
void seed_curve_and_noise(const JointProblem& problem, int order, JointState& state);

/// A standard deviation below this fraction of its start is a collapse: the likelihood is unbounded. Far below what the
/// errors of the stops make of the seed's sigma where the readings are all but exact.
inline constexpr double collapse_ratio = 1e-9;

}  // namespace rangecal
