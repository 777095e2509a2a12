// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// One Gauss-Newton step of all mean and variance parameters; those at a bound beyond which the likelihood rises stay there.
struct ParameterStep {
  Eigen::VectorXd parameters;
  Eigen::MatrixXd covariance;
  double predicted_gain = 0.0;        ///< [nats]
  std::vector<Signature> signatures;  ///< of the parameters; empty ones of those that move no mean
};

/// That at the state of `projector`; none where nothing can move.
std::optional<ParameterStep> newton_parameters(const Rows& rows, const WorkingProblem& working,
                                               const Projector& projector, const Model& model,
                                               const std::vector<FreeParameter>& free);

/// Searches one parameter that only the value of the likelihood knows, in its logarithm where it is positive: outwards by
/// hops that double, a factor `reach` first (else `reach` - 1 typical sizes), then to the vertex of a parabola.
void search_line(const Rows& rows, const FreeParameter& p, const RefitOptions& options, double reach,
                 Fit& fit);

/// Fits the parameters of the tails at the errors that the readings have (likeliest_tails), and the rest by calibrate_under, in turn.
void fit_tails(const Rows& rows, const RefitOptions& options, Fit& fit);

/// Fits the parameters of errors that wander along a sequence: those that make the residuals of the fit, their common scale
/// free, most likely, and the rest by calibrate_under, in turn.
void fit_sequence(const Rows& rows, const RefitOptions& options, Fit& fit);

}  // namespace rangecal::diagnosis
