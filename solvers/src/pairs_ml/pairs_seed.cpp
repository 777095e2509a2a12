// SPDX-License-Identifier: BSD-3-Clause
// Where the search of the pairs' likelihood begins.
#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "pairs_newton.hpp"

namespace rangecal::pairs_ml {

Vector ScaledPairs::least_squares() const {
  // Normal equations over powers of t in [-1, 1] (condition below 1e4 for order 4); s as d^p, d kept off 0.
  const int n = order_ + 1;
  const std::size_t size = problem_.size(), stride = std::max<std::size_t>(1, size / 4096);
  const double power = form_of(law_).power_of_f + form_of(law_).power_of_d;
  const double floor = 0.05 * std::max(std::abs(center_), half_width_);
  double moments[2 * max_unknowns] = {}, right[max_unknowns] = {};
  for (std::size_t i = 0; i < size; i += stride) {
    const double d = problem_.true_m[i], t = (d - center_) / half_width_;
    const double scale = std::max(std::abs(d), floor), scale_sq = scale * scale;
    double w = problem_.weight[i];
    if (power == 1.0) w /= scale_sq;
    if (power == 2.0) w /= scale_sq * scale_sq;
    if (power == 3.0) w /= scale_sq * scale_sq * scale_sq;
    double wy = w * problem_.mean_m[i];
    for (int k = 0; k < n; ++k, wy *= t) right[k] += wy;
    for (int k = 0; k < 2 * n - 1; ++k, w *= t) moments[k] += w;
  }
  Matrix A(n, n);
  Vector b(n);
  for (int j = 0; j < n; ++j) {
    b[j] = right[j];
    for (int k = 0; k < n; ++k) A(j, k) = moments[j + k];
  }
  return A.ldlt().solve(b);
}

bool ScaledPairs::quick_seed(Vector& x) const {
  // One pass of the kernel at f = 0, sigma = 1 holds the normal equations of least squares with s as d^2 (constant
  // noise: s constant), and with them its sum of squares.
  const int n = order_ + 1;
  const bool constant = law_ == NoiseLaw::constant;
  if (!streams() || (!constant && !(problem_.true_m.front() > 0.02 * half_width_))) return false;
  const KernelSums sums = sum(sampled() ? sample_ : problem_, Vector::Zero(n + 1), false,
                              constant ? KernelLaw::power0 : KernelLaw::d_squared);
  Matrix A(n, n);
  Vector b(n);
  for (int j = 0; j < n; ++j) {
    b[j] = -sums.gradient[j];
    for (int k = 0; k < n; ++k) A(j, k) = sums.hessian[j + k];
  }
  const Eigen::LLT<Matrix> factor(A);
  if (factor.info() != Eigen::Success) return false;
  const Vector c = factor.solve(b);
  const double square = sums.square - c.dot(b);
  if (!c.allFinite() || !(square > 1e-9 * sums.square)) return false;  // cancelled: the plain way sees better
  x.resize(n + 1);
  x.head(n) = c;
  // sigma d^2 and sigma f^p agree at the middle reading.
  x[n] = 0.5 * std::log(square / sums.count);
  if (power_ > 0.0)
    x[n] += 2.0 * std::log(problem_.true_m[problem_.size() / 2]) - power_ * std::log(typical_);
  if (sampled()) x = refine_on_sample(x);
  return true;
}

Vector ScaledPairs::seed() const {
  const int n = order_ + 1;
  const auto f_at = [&](const Vector& c, double d) {
    const double t = (d - center_) / half_width_;
    double f = 0.0;
    for (int k = n - 1; k >= 0; --k) f = f * t + c[k];
    return f;
  };
  const std::size_t size = problem_.size(), stride = std::max<std::size_t>(1, size / 4096);
  // sigma^2 = mean of ((y - f)^2 + S^2) / (s / sigma)^2 at the seed; false where f leaves the domain.
  const auto sigma_sq = [&](const Vector& c, double& out) {
    double square = 0.0, count = 0.0;
    for (std::size_t i = 0; i < size; i += stride) {
      const double d = problem_.true_m[i], f = f_at(c, d), r = problem_.mean_m[i] - f;
      if (power_ > 0.0 && !(f > 0.02 * std::abs(problem_.mean_m[i]))) return false;
      double shape = 1.0;
      for (int i = 0; i < form_of(law_).power_of_d; ++i) shape *= d;
      if (power_ >= 1.0) shape *= f;
      if (power_ >= 2.0) shape *= f;
      if (power_ >= 3.0) shape *= f;
      square += problem_.weight[i] * (r * r + problem_.mean_square[i]) / (shape * shape);
      count += problem_.count[i];
    }
    out = square / count;
    return true;
  };
  Vector c = least_squares();
  double variance = 0.0;
  if (!c.allFinite() || !sigma_sq(c, variance)) {
    // Where least squares leaves f > 0: a straight line, or a constant, through the mean reading.
    double y = 0.0, d = 0.0;
    for (std::size_t i = 0; i < size; ++i) {
      y += problem_.mean_m[i];
      d += problem_.true_m[i];
    }
    c = Vector::Zero(n);
    c[0] = y / static_cast<double>(size);
    if (n > 1 && d > 0.0 && problem_.true_m.front() > 0.0) {
      c[0] = y / d * center_;
      c[1] = y / d * half_width_;
    }
    if (!sigma_sq(c, variance)) variance = 1.0;
  }
  const double tiny = 1e-30 * (1.0 + typical_ * typical_);
  Vector x = Vector::Zero(unknowns());
  x.head(n) = c;
  if (!has_sigma(law_)) {
    x[n] = std::sqrt(std::max(variance, tiny));
  } else {
    x[n] = 0.5 * std::log(std::max(variance, tiny));
  }
  return sampled() ? refine_on_sample(x) : x;
}

Vector ScaledPairs::refine_on_sample(Vector x) const {
  // The constant of finish counts all cells, which every value here shares.
  Evaluation at, there;
  finish(sum(sample_, x, false, kernel_law_), x, false, at);
  for (int iteration = 0; iteration < 4 && at.valid; ++iteration) {
    const Eigen::LLT<Matrix> factor(at.hessian);
    if (factor.info() != Eigen::Success) break;
    const Vector step = factor.solve(at.gradient);
    const Vector trial = x - step;
    finish(sum(sample_, trial, false, kernel_law_), trial, false, there);
    if (!there.valid || !(there.nll <= at.nll)) break;
    const double decrement_sq = step.dot(at.gradient);
    x = trial;
    if (decrement_sq < 1e-2) break;  // the sample itself is further off than that
    std::swap(at, there);
  }
  return x;
}

}  // namespace rangecal::pairs_ml
