// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <utility>

namespace rangecal::diagnosis {

/// Slope of the log likelihood in what is fitted, and the information on it.
struct ScoringSlopes {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
};

/// Scoring from `here` until a step promises next to nothing:
///
///   step = (I + lambda diag I)^-1 score
///
/// lambda is Levenberg's, 0 where steps gain. A step is taken where the NLL at its end is lower. A Point has an `nll` [nats];
/// slopes(point) gives ScoringSlopes, moved(point, step) the point a step away.
template <typename Point, typename SlopesAt, typename Moved>
Point scored(Point here, const SlopesAt& slopes, const Moved& moved) {
  constexpr int most_steps = 40, most_failures = 6;
  constexpr double settled = 2e-3;                                           // nats
  constexpr double first_damping = 1e-2, more = 10.0, least_damping = 1e-3;  // lambda
  double damping = 0.0;
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
      if (solved && !(0.5 * at.score.dot(step) > settled)) return here;
      Point next = solved ? moved(here, step) : Point{};
      gain = here.nll - next.nll;
      if (gain > 0.0) {
        here = std::move(next);
        damping = damping > least_damping ? damping / more : 0.0;
      } else {
        damping = std::max(first_damping, more * damping);
      }
    }
    if (!(gain > settled)) return here;
  }
  return here;
}

}  // namespace rangecal::diagnosis
