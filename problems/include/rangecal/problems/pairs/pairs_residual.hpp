// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "rangecal/core/noise.hpp"

namespace rangecal {

/// One cell of R readings of mean `mean_m` and mean square deviation `mean_square` at the true distance d, as three
/// residuals whose half sum of squares is the negative log-likelihood of the cell (Alhashimi 2016, eq. 18) up to
/// the constant R (log(2 pi) / 2 + log s_floor):
///
///   sqrt(R) (mean - f) / s,   sqrt(R) S / s,   sqrt(2 R log(s / s_floor)),    S = sqrt(mean_square)
///
/// f = sum_i alpha_i d^i [m]; s the noise law at d [m], noise parameters as log sigma (power laws, d_squared) or
/// beta (polynomial). This keeps the log-determinant in a least-squares program as long as s > s_floor; with
/// s_floor = s(current) e^(-1/2) the Gauss-Newton matrix has the Fisher information as its expectation.
/// The likelihood: docs/equations.md, "The two likelihoods".
struct PairsResidual {
  double d = 0.0, mean_m = 0.0, mean_square = 0.0, count = 1.0;
  NoiseLaw law = NoiseLaw::f_squared;
  double s_floor = 0.0;  ///< [m]

  /// Spread [m] at alpha and the noise parameters (log sigma or beta); not positive outside of the model's domain.
  double spread(const Eigen::Ref<const Eigen::VectorXd>& alpha,
                const Eigen::Ref<const Eigen::VectorXd>& noise) const;

  /// Residuals (dimensionless, 3) and, where not null, their row-major Jacobians (3 x alpha.size(), 3 x noise.size()).
  /// False, with nothing written, where s <= s_floor.
  bool evaluate(const Eigen::Ref<const Eigen::VectorXd>& alpha,
                const Eigen::Ref<const Eigen::VectorXd>& noise, double* residuals, double* in_alpha,
                double* in_noise) const;
};

}  // namespace rangecal
