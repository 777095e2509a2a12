// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// How far a stop may be from its commanded pose: variance of x and of y [m^2], and of the heading [rad^2].
struct StopVariance {
  double xy_sq = 0.0, heading_sq = 0.0;
};

/// Of every stop; along a random walk the variances of the steps add up.
inline std::vector<StopVariance> stop_variances(const JointProblem& problem,
                                                std::optional<double> sigma_s_m) {
  std::vector<StopVariance> variances(problem.stops.size());
  for (std::size_t k = 0; k < variances.size(); ++k) {
    const StopPrior& prior = problem.stops[k];
    const double sigma_xy = sigma_s_m.value_or(prior.sigma_xy_m), sigma_h = prior.sigma_heading_rad;
    variances[k] = {sigma_xy * sigma_xy, sigma_h * sigma_h};
    if (!prior.chained || k == 0) continue;
    if (prior.place == problem.stops[k - 1].place) variances[k].xy_sq = 0.0;  // turned, not moved
    variances[k].xy_sq += variances[k - 1].xy_sq;
    variances[k].heading_sq += variances[k - 1].heading_sq;
  }
  return variances;
}

}  // namespace rangecal
