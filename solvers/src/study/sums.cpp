// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/study/sums.hpp"

#include <cmath>
#include <limits>

#include "rangecal/core/polynomial.hpp"

namespace rangecal {

StudyLayout::StudyLayout(const Study& study, const StudyPoint& point)
    : curve(static_cast<int>(study.curve_m.size())), estimators(static_cast<int>(study.estimators.size())) {
  const Scene& scene = point.scene;
  landmarks =
      static_cast<int>(scene.positions.size()) + (scene.random_landmarks ? scene.random_landmarks->count : 0);
  const auto next = [this](int count) {
    const int at = stride;
    stride += count;
    return at;
  };
  outcome = next(study_outcomes);
  answers = next(1);
  landmark_error = next(2 * landmarks);
  landmark_square = next(2 * landmarks);
  landmark_total = next(1);
  landmark_total_square = next(1);
  curve_error = next(curve);
  curve_square = next(curve);
  curve_total = next(1);
  curve_total_square = next(1);
  sigma_e = next(3);
  sigma_theta = next(3);
  mse = next(mse_slots);
  order = next(study_highest_order + 1);
  cover = next(4);
  aic = next(study_highest_order + 2);
  power = next(8);
  bound = stride * estimators;
  size = bound + 3;
}

void StudySums::prepare(const StudyLayout& layout) {
  repeats = 0;
  numbers.assign(layout.size, 0.0);
  seconds.assign(layout.estimators + 1, 0.0);
}

void StudySums::add(const StudySums& other) {
  repeats += other.repeats;
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i] += other.numbers[i];
  for (std::size_t i = 0; i < seconds.size(); ++i) seconds[i] += other.seconds[i];
}

double least_squares_distance(const Eigen::VectorXd& alpha, double y) {
  constexpr double farthest = std::numeric_limits<double>::max();
  double nearest = std::numeric_limits<double>::quiet_NaN();
  const auto consider = [&](double d) {
    if (d > 0.0 && std::isfinite(d) && !(std::abs(d - y) >= std::abs(nearest - y))) nearest = d;
  };
  const Eigen::Index n = alpha.size() - 1;
  if (n == 1) {
    consider((y - alpha[0]) / alpha[1]);
  } else if (n ==
             2) {  // without cancellation: q = -(b + sign(b) sqrt(b^2 - 4 a c)) / 2, roots q / a and c / q
    const double a = alpha[2], b = alpha[1], c = alpha[0] - y, disc = b * b - 4.0 * a * c;
    if (disc >= 0.0) {
      const double q = -0.5 * (b + std::copysign(std::sqrt(disc), b));
      consider(q / a);
      consider(c / q);
    }
  } else if (n > 2) {
    Eigen::VectorXd shifted = alpha;
    shifted[0] -= y;
    for (const double root : real_roots(shifted, 0.0, farthest)) consider(root);
  }
  if (std::isfinite(nearest)) return nearest;
  // No root: where f comes nearest to y, an end or a turning point.
  Eigen::VectorXd slope(std::max<Eigen::Index>(n, 1));
  slope.setZero();
  for (Eigen::Index i = 1; i <= n; ++i) slope[i - 1] = static_cast<double>(i) * alpha[i];
  double best = 0.0, best_gap = std::abs(evaluate_polynomial(alpha, 0.0) - y);
  for (const double d : real_roots(slope, 0.0, farthest)) {
    const double gap = std::abs(evaluate_polynomial(alpha, d) - y);
    if (gap < best_gap) {
      best = d;
      best_gap = gap;
    }
  }
  return best;
}

}  // namespace rangecal
