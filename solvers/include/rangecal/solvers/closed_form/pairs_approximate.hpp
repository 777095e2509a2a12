// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

#include "rangecal/core/outcome.hpp"

namespace rangecal {

/// Approximate maximum likelihood with known distances and noise d^2 (Alhashimi 2016, eq. 21-26).
struct PairsApproximate {
  Outcome outcome = Outcome::failed;
  std::string reason;
  Eigen::VectorXd alpha;
  Eigen::MatrixXd alpha_covariance;  ///< (H^T H)^-1 ||y~ - H alpha||^2 / (N - n - 1); empty where N = n + 1
  double sigma_e_sq_printed =
      0.0;  ///< eq. 26: ||y~ - H alpha||^2 / N, mean square of (y - f(d)) / d^2  [1/m^2]
  double sigma_e_sq_reweighted =
      0.0;           ///< sigma_e^2 of eq. 1: sum of ((y - f(d)) / f(d)^2)^2 over N - n - 1; 0 where N = n + 1;
                     ///< NaN where f is not positive at a reading [1/m^2]
  double nll = 0.0;  ///< under y ~ N(f(d), sigma_e^2 d^4) at the printed sigma_e^2 [nats]
};

/// y = f(d) + d^2 e (21), divided by d^2: y/d^2 = sum_i alpha_i d^(i-2) + e (22-24); alpha = (H^T H)^-1 H^T
/// y~ (25), rows of H (d^-2, ..., d^(n-2)), solved by pivoted QR. y, d in metres. Since the noise of model
/// (1) is f(d)^2 e and not d^2 e, the printed sigma_e^2 is that of eq. 1 times about the mean of (f/d)^4: the re-weighted
/// one is given beside it. Precondition: d > 0, finite, equal sizes (InputError). Outcomes as fit_polynomial.
/// Cost: O(N n^2).
PairsApproximate approximate_pairs_fit(std::span<const double> d, std::span<const double> y, int order);

}  // namespace rangecal
