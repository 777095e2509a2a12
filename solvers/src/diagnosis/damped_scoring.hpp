// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "solver_log.hpp"

namespace rangecal::diagnosis {

/// Gradient of the log likelihood in the fitted parameters, and their information matrix.
struct ScoringSlopes {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
};

/// Fisher scoring from `here`, until the predicted gain of a step is negligible:
///
///   step = (I + lambda diag I)^-1 score
///
/// lambda is Levenberg's damping, 0 as long as steps gain. A step is accepted if it lowers the NLL. A Point has an `nll` [nats];
/// slopes(point) gives ScoringSlopes, moved(point, step) the point a step away; `name` is that of the solver in the log.
template <typename Point, typename SlopesAt, typename Moved>
Point scored(const char* name, Point here, const SlopesAt& slopes, const Moved& moved) {
  constexpr int most_steps = 40, most_failures = 6;
  constexpr double settled = 2e-3;                                           // nats
  constexpr double first_damping = 1e-2, more = 10.0, least_damping = 1e-3;  // lambda
  const SolverLog log(name);
  double damping = 0.0;
  const auto ended = [&](int iterations, const char* why) {
    log.end(iterations, here.nll, why);
    return std::move(here);
  };
  for (int iteration = 0; iteration < most_steps; ++iteration) {
    const ScoringSlopes at = slopes(here);
    const Eigen::VectorXd scale = at.information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    const Eigen::MatrixXd scaled = scale.asDiagonal() * at.information * scale.asDiagonal();
    double gain = 0.0;
    for (int failure = 0; failure < most_failures && !(gain > 0.0); ++failure) {
      Eigen::MatrixXd damped = scaled;
      damped.diagonal().array() += damping + 1e-9;
      const Eigen::LDLT<Eigen::MatrixXd> factor(damped);
      const Eigen::VectorXd step = scale.cwiseProduct(factor.solve(scale.cwiseProduct(at.score)));
      const bool solved = factor.info() == Eigen::Success && step.allFinite();
      if (solved && !(0.5 * at.score.dot(step) > settled))
        return ended(iteration, "the next step promises next to nothing");
      Point next = solved ? moved(here, step) : Point{};
      gain = here.nll - next.nll;
      const double length = std::sqrt(at.score.dot(step));
      log.iteration(iteration + 1, std::min(here.nll, next.nll), gain > 0.0 ? length : 0.0, length,
                    {"lambda", damping});
      if (gain > 0.0) {
        here = std::move(next);
        damping = damping > least_damping ? damping / more : 0.0;
      } else {
        damping = std::max(first_damping, more * damping);
      }
    }
    if (!(gain > settled))
      return ended(iteration + 1,
                   gain > 0.0 ? "the last step gained next to nothing" : "no damped step lowers the cost");
  }
  return ended(most_steps, "no iterations are left");
}

}  // namespace rangecal::diagnosis
