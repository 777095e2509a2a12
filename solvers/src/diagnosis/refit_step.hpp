// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// One Gauss-Newton step for all mean and variance parameters at the fit's model and state; fills the covariance, and the
/// nats that the step promises. False if nothing can move.
bool newton_parameters(const Rows& rows, const WorkingProblem& working, const JointState& state,
                       const Model& model, const std::vector<FreeParameter>& free, Eigen::VectorXd& step,
                       Eigen::MatrixXd& covariance, double& promised);

/// Searches one parameter that only the value of the likelihood knows, by steps that shrink: a factor `reach`
/// first for one that is positive, else its typical size.
void search_line(const Rows& rows, const FreeParameter& p, const RefitOptions& options, double reach,
                 Fit& fit);

}  // namespace rangecal::diagnosis
