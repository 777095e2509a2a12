// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>
#include <vector>

#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal {

/// What robust noise shapes add to a fit. Ranges and bearings have shape parameters of their own, of one family.
struct RobustShapes {
  NoiseShapeParameters range, bearing;
  /// Standard deviations of their parameters, in their order (nu; or p, k); empty where there are none, or one is at the
  /// end of its range.
  std::vector<double> range_std, bearing_std;
  double nll = 0.0;  ///< of the shapes delivered: joint for `full`, Laplace's for `marginal` [nats]
  double aic = 0.0;  ///< 2 (nll + parameters: globals not held and shapes)
  int rounds = 0;    ///< of expectation and maximisation
  std::vector<std::pair<NoiseShape, double>> tried;  ///< AIC of each shape tried
};
struct RobustJointFit {
  JointFit fit;
  RobustShapes shapes;
};
struct RobustMarginalFit {
  MarginalFit fit;
  RobustShapes shapes;
};

/// Both likelihoods with given shapes.
struct RobustNll {
  bool ok = false;        ///< false: the state lies outside of the domain, or its stops have no optimum
  double joint = 0.0;     ///< at the state's stops [nats]
  double marginal = 0.0;  ///< joint + Laplace's part for the stops, by the weighted squares [nats]
};

/// The joint likelihood with heavy tails, per reading i of range (and of bearing likewise):
///
///   -log p = log s_i - log rho(z_i),   z_i = (y_i - f(d_i)) / s_i,   rho: Student's t or a contaminated normal, scale 1.
///
/// Expectation and maximisation: with w_i = -rho'(z_i) / (z_i rho(z_i)) held (Cells::range_weight, bearing_weight), the
/// fit is that of Gaussian noise with weighted squares, log s_i + w_i z_i^2 / 2, by solve_joint_block; then shapes and
/// weights are renewed at its residuals. The likelihood falls at every round; no round is taken that does not gain
/// (of `marginal`: the rounds end where its likelihood stands still, nu allowing for the parameters fitted as sigma does).
/// Source: Lange, Little, Taylor 1989 (t); the weights of a contaminated normal are the posterior mean of 1 or 1 / k^2.
///
/// `automatic` tries all three shapes and keeps the lowest AIC. Covariances are those of the likelihood of the shapes, whose
/// parameters are estimated beside all else: what the weighted Gaussian says is corrected by what a reading of the shape
/// is expected to tell (shape_information). A shape parameter at the end of its range counts as known.
/// Throws InputError unless every cell holds one reading (Grouping::rows). Cost: some 10 to 60 solves from warm starts.
RobustJointFit solve_joint_robust(const JointProblem& rows, const JointState& start, NoiseShape shape,
                                  const JointOptions& options = {});

/// The same around solve_marginal: the weights are taken at the stops' conditional optimum, and nll is l_s of the
/// weighted fit with its Gaussian share replaced by that of the shapes.
RobustMarginalFit solve_marginal_robust(const JointProblem& rows, const JointState& start, NoiseShape shape,
                                        const MarginalOptions& options = {});

/// The likelihoods that the two above minimise, at a given state: what `nll` is made of, for scores side by side.
/// Throws InputError unless every cell holds one reading. Cost: linear in the readings.
RobustNll robust_nll(const JointProblem& rows, const JointState& state, const NoiseShapeParameters& range,
                     const NoiseShapeParameters& bearing);

}  // namespace rangecal
