// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {

/// The stops at their conditional optimum, and Laplace's approximation of the likelihood with the stops integrated
/// out, at given alpha, noise and landmarks.
struct LaplaceValue {
  JointState state;           ///< the given state with its stops at their optimum
  bool ok = false;            ///< false: no positive definite optimum was found
  double joint_nll = 0.0;     ///< [nats]
  double marginal_nll = 0.0;  ///< joint + 1/2 log det H_ss - (dim / 2) log(2 pi) [nats]
};

/// Minimises the joint NLL over the stops alone, then applies Laplace's method (docs/equations.md, "The two likelihoods"): l_s(phi;
/// sigma) = min over stops + 1/2 log det H_ss, H_ss the exact Hessian at that optimum, constants included.
LaplaceValue laplace_marginal(const JointProblem& problem, const JointState& state);

/// A standard deviation that is estimated: of the ranges (sigma_e), of the bearings, of the stops.
enum class Sigma { noise, theta, stops };

/// What REML adds to l_s, as a solve ended: its slopes, and how phi-hat turns with sigma beyond what A predicts (see
/// solve_marginal). A solve of nearly the same problem that begins with them takes half the evaluations.
struct RemlSlopes {
  Eigen::VectorXd slopes;        ///< in the sigmas
  Eigen::MatrixXd further_turn;  ///< phi by sigmas
};

struct MarginalOptions {
  int max_iterations = 100;  ///< Newton iterations
  int max_outer = 80;        ///< updates of the REML slopes
  double gradient_tolerance = 1e-7;
  bool estimate_sigma_s = false;  ///< sigma_s of the shared stops is a parameter
  Held held;
  std::optional<Sigma> held_sigma;  ///< noise or theta: this one alone stays where it is
  std::optional<RemlSlopes>
      begin;  ///< where the slopes begin; of other sizes than this problem's they are not used
};

/// Result of `marginal`; JointFit's covariance and weakest direction are those of the marginal likelihood.
struct MarginalFit : JointFit {
  double marginal_nll = 0.0;       ///< l_s at the estimate [nats]
  std::optional<RemlSlopes> reml;  ///< where it converged
  std::optional<double>
      sigma_s_upper95_m;  ///< where sigma_s is estimated at 0: one-sided 95 % limit (profile)
};

/// `marginal`: phi = (alpha, landmarks) minimise l_s; sigma = (noise, sigma_theta, sigma_s where asked) minimise
/// l_s at phi-hat(sigma) + 1/2 log det A, A = d2 l_s / dphi2 (REML, flat prior on phi). Solved as a fixed point: with
/// the REML slopes c = d(1/2 log det A)/dsigma held, l_s + c . sigma is one smooth function, of which Newton's method takes
/// one step at a time with the stops moving along towards their conditional optimum; c is renewed in between, in closed form
/// but for a small part of how phi-hat turns with sigma. A free sigma_s is searched on the REML criterion with all else profiled out, since the fixed point
/// creeps where it is small; the fixed point then only refines it.
/// A sigma that the likelihood draws to 0, since the errors of the stops explain all that it would, is held where it no
/// longer matters (a thousandth of a nat), and `reason` says so beside the outcome `converged`.
/// A is taken from the joint Hessian's Schur complement; the second derivative of 1/2 log det H_ss in phi, which is
/// smaller by the number of readings per stop, is left out of A (not of the gradient). gradient_norm is that of all
/// globals not held, at the estimate.
/// Cost: linear in the cells per evaluation; 10 to 15 evaluations, twenty times as many with sigma_s free.
MarginalFit solve_marginal(const JointProblem& problem, const JointState& start,
                           const MarginalOptions& options = {});

}  // namespace rangecal
