// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>

#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"

namespace rangecal::pairs_ml {

struct DenseNewton {
  Eigen::VectorXd x;
  PairsDerivatives at;  ///< at x
  int iterations = 0;
  Outcome outcome =
      Outcome::not_converged;  ///< converged; not_converged; failed: the start is outside the domain
};

/// Minimises any nll with pairs_derivatives' fields over a few unknowns: Newton steps on the second derivatives, on the
/// information where these are not positive definite, cut until the nll falls; ends at a Newton decrement below 1e-5,
/// from where the last step leaves a distance of its square.
DenseNewton minimise(const std::function<PairsDerivatives(const Eigen::VectorXd&)>& evaluate,
                     Eigen::VectorXd x);

}  // namespace rangecal::pairs_ml
