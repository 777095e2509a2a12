// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {

/// A channel's shape at the estimate, and what its readings leave of its squares.
struct ShapeAtEstimate {
  NoiseShapeParameters shape;
  double squares = 0.0;  ///< sum w z^2: N, or N less the parameters fitted, where sigma allows for them
  std::vector<double>
      shape_std;  ///< out: of the shape's parameters; empty where there are none, or at a limit
  double spread =
      1.0;  ///< the typical spread of a reading, which a one-sided outlier's mean is compared with [m; rad]
};

/// The part of H that shapes change, of phi = (alpha, landmarks) alone: the Schur complement with what readings of the
/// shapes are expected to tell of their mean less that with the weights, sigmas held. Empty where the stops have no optimum.
/// `state`: with the stops at theirs.
Eigen::MatrixXd shape_information_gap(const JointProblem& weighted, const JointState& state,
                                      const NoiseShapeParameters& range, const NoiseShapeParameters& bearing,
                                      double range_spread_m);

/// What `readings` of a shape tell of log sigma beyond the weights' 2 each, and what its parameters, estimated too, add to the
/// variance of log sigma, `at` in `covariance`; returns their standard deviations, empty where there are none.
double shape_information_of_log_sigma(const NoiseShapeParameters& shape, double spread, double readings);
std::vector<double> add_shape_uncertainty(const NoiseShapeParameters& shape, double spread, double readings,
                                          int at, Eigen::MatrixXd& covariance);

/// Replaces the covariance of a fit with held weights by that of the likelihood of the shapes, their
/// parameters estimated too.
///
/// Held weights say w / s^2 of a mean, E w / s^2 on average, and 2 of log s per reading; readings of a shape
/// say i / s^2 and j (shape_information): 0.71 and 1.14 of Student's t with nu = 4, where E w = 1; 0.83 and
/// 1.52 of the contaminated normal with p = 0.1 and k = 10, where E w = 0.90. With a, b the gradients of f
/// and log s of a reading in all unknowns
///
///   H = H_weights + sum over readings [ (i - E w) a a^T / s^2 + q (j - 2) b b^T ],
///   q = min(1, sum w z^2 / N),
///
/// from which the stops are eliminated. A sigma that is estimated makes sum w z^2 equal to N, or to N less the
/// parameters that it allows for; beyond N it lies only where sigma is held or did not settle, and readings that
/// scatter more than it says tell no more of it than N do: hence the cap. Where the weights lie so unevenly
/// over the stops that this is not positive definite, H is what is expected alone,
/// sum [ i a a^T / s^2 + q j b b^T ] and the priors. The shape's parameters eta are coupled to log s alone:
/// c = i_s_eta / j. Along v, the direction that scales s (log sigma itself, or beta), they add,
/// V = [N (I_eta - j c c^T)]^-1 being their covariance,
///
///   cov = H^-1 + v v^T c^T V c.
///
/// Our derivation: the Schur complement of the information over (unknowns, eta). `weighted`: the problem with
/// the weights of the estimate; `marginal`: with the log-determinant's part of the sigmas, as solve_marginal
/// has it. A fit without a covariance keeps none. Cost: three assemblies.
void set_robust_covariance(const JointProblem& weighted, bool marginal, ShapeAtEstimate& range,
                           ShapeAtEstimate& bearing, JointFit& fit);

}  // namespace rangecal
