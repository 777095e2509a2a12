// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "pairs_newton.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal::pairs_ml {

/// "0.71 alpha_0 - 0.70 alpha_1", leaving out what is below 0.01 % of the largest.
std::string name_direction(const Eigen::VectorXd& direction);

/// The direction of largest variance of alpha, each alpha_i taken by what it moves f at `reference_m`, as the step of
/// one standard deviation along it.
std::string weakest_direction(const Matrix& alpha_covariance, double reference_m);

/// Coefficients of the polynomial with roots at the distinct distances: what can be added to f unseen.
Eigen::VectorXd unseen_polynomial(const std::vector<double>& distances);

/// Fills alpha covariance, standard deviations and the weakest direction from the covariance of (alpha, noise).
void set_covariance(Calibration& calibration, const Matrix& covariance, double reference_m);

/// AIC, AICc, BIC of `parameters` parameters and N readings.
OrderScore score_order(int order, double nll, int parameters, double readings, Outcome outcome);

}  // namespace rangecal::pairs_ml
