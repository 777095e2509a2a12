// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>

#include "rangecal/core/noise.hpp"
#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"

namespace rangecal {

struct PairsCeresResult {
  Eigen::VectorXd alpha;
  Noise noise;
  double nll = 0.0;            ///< pairs_nll at the estimate [nats]
  double gradient_norm = 0.0;  ///< sqrt(g' I^-1 g), dimensionless
  int anchorings = 0;          ///< how often the floors were set
  int iterations = 0;          ///< Ceres iterations over all of them
  Outcome outcome = Outcome::failed;
  std::string reason;
};

/// The same optimum as full_pairs by Ceres, as an independent check: the residuals of PairsResidual, in coordinates
/// whitened by the expected information at the start, solved for a few trust-region steps with the floors
/// s_floor = s(current) e^(-1/2), which are then set anew, until the gradient vanishes. Ceres's Gauss-Newton matrix
/// has the Fisher information as its expectation, so this is Fisher scoring. Gaussian noise.
/// Cost: 3 residuals per cell (2 where nothing repeats), 6 to 20 anchorings.
PairsCeresResult full_pairs_ceres(const PairsProblem& problem, int order, NoiseLaw law = NoiseLaw::f_squared,
                                  int noise_order = 1);

}  // namespace rangecal
