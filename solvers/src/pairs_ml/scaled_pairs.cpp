// SPDX-License-Identifier: BSD-3-Clause
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "pairs_newton.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::pairs_ml {
namespace {

constexpr std::size_t chunk_cells = 8192;    // fixed, so that the sums do not depend on the threads
constexpr std::size_t sample_cells = 16384;  // above 4 times as many, the seed comes from every k-th cell

/// Every k-th value, about sample_cells of them.
std::vector<double> every_kth(const std::vector<double>& values) {
  const std::size_t stride = values.size() / sample_cells;
  std::vector<double> taken((values.size() + stride - 1) / stride);
  for (std::size_t i = 0; i < taken.size(); ++i) taken[i] = values[i * stride];
  return taken;
}

/// The kernel's specialisation for a law of one sigma; power0 stands for the polynomial, which never streams.
KernelLaw kernel_law(NoiseLaw law) {
  switch (law) {
    case NoiseLaw::f:
      return KernelLaw::power1;
    case NoiseLaw::f_squared:
      return KernelLaw::power2;
    case NoiseLaw::f_cubed:
      return KernelLaw::power3;
    case NoiseLaw::d_squared:
      return KernelLaw::d_squared;
    case NoiseLaw::constant:
    case NoiseLaw::polynomial:
      break;
  }
  return KernelLaw::power0;
}

}  // namespace

Matrix shift_matrix(int order, double center, double half_width) {
  Matrix shift = Matrix::Zero(order + 1, order + 1);
  Vector column = Vector::Zero(order + 1);  // ((d - center) / half_width)^k in powers of d
  column[0] = 1.0;
  for (int k = 0; k <= order; ++k) {
    shift.col(k) = column;
    for (int j = order; j >= 0; --j)
      column[j] = ((j > 0 ? column[j - 1] : 0.0) - center * column[j]) / half_width;
  }
  return shift;
}

ScaledPairs::ScaledPairs(const PairsProblem& problem, int order, NoiseLaw law, int noise_order,
                         int parallel_from)
    : problem_(problem),
      order_(order),
      noise_count_(parameter_count(law, noise_order)),
      law_(law),
      kernel_law_(kernel_law(law)),
      power_(form_of(law).power_of_f),
      parallel_from_(parallel_from) {
  const double low = problem.true_m.front(), high = problem.true_m.back();
  center_ = 0.5 * (low + high);
  half_width_ = high > low ? 0.5 * (high - low) : 1.0;
  typical_ = std::abs(problem.mean_m[problem.size() / 2]);
  if (!(typical_ > 0.0)) typical_ = 1.0;
  log_constant_ = problem.readings() * half_log_two_pi;
  if (power_ > 0.0) log_constant_ += problem.readings() * power_ * std::log(typical_);
  if (law == NoiseLaw::d_squared) {
    for (std::size_t i = 0; i < problem.size(); ++i)
      log_constant_ += problem.count[i] * 2.0 * std::log(problem.true_m[i]);
  }
  if (!streams()) {
    scaled_ = problem;
    if (!has_sigma(law)) {
      for (double& d : scaled_.true_m) d = (d - center_) / half_width_;
    }
  } else if (problem.size() > chunk_cells) {
    chunks_.resize((problem.size() + chunk_cells - 1) / chunk_cells);
    if (problem.size() >= 4 * sample_cells) {
      sample_.single = problem.single;
      sample_.true_m = every_kth(problem.true_m);
      sample_.mean_m = every_kth(problem.mean_m);
      if (!problem.single) {
        sample_.mean_square = every_kth(problem.mean_square);
        sample_.count = every_kth(problem.count);
        sample_.weight = every_kth(problem.weight);
      }
    }
  }
}

KernelSums ScaledPairs::sum(const PairsProblem& problem, const Vector& x, bool information,
                            KernelLaw law) const {
  KernelInput input;
  input.d = problem.true_m.data();
  input.mean = problem.mean_m.data();
  input.mean_square = problem.mean_square.data();
  input.count = problem.count.data();
  input.weight = problem.weight.data();
  input.center = center_;
  input.inverse_half_width = 1.0 / half_width_;
  for (int k = 0; k <= order_; ++k) input.c[k] = x[k];
  input.inverse_sigma_sq = std::exp(-2.0 * x[order_ + 1]);
  input.inverse_f_scale = 1.0 / typical_;
  KernelSums total;
  const std::size_t size = problem.size();
  if (size <= chunk_cells || &problem == &sample_) {
    input.end = size;
    run_kernel(input, law, order_, problem.single, information, total);
    return total;
  }
  const auto run = [&](std::size_t chunk) {
    KernelInput part = input;
    part.begin = chunk * chunk_cells;
    part.end = std::min(size, part.begin + chunk_cells);
    chunks_[chunk] = KernelSums{};
    run_kernel(part, law, order_, problem.single, information, chunks_[chunk]);
  };
  if (size >= static_cast<std::size_t>(parallel_from_)) {
    tbb::task_group_context own(
        tbb::task_group_context::isolated);  // whole, whatever becomes of what asked for it
    tbb::parallel_for(
        tbb::blocked_range<std::size_t>(0, chunks_.size(), 2),
        [&](const auto& range) {
          for (std::size_t chunk = range.begin(); chunk != range.end(); ++chunk) run(chunk);
        },
        own);
  } else {
    for (std::size_t chunk = 0; chunk < chunks_.size(); ++chunk) run(chunk);
  }
  for (const KernelSums& part : chunks_) total.add(part, order_);
  return total;
}

void ScaledPairs::finish(const KernelSums& sums, const Vector& x, bool information, Evaluation& out) const {
  const int n = order_ + 1;
  out.nll = log_constant_ + sums.count * x[n] + power_ * sums.log_f + 0.5 * sums.square;
  out.valid = std::isfinite(out.nll) && (power_ == 0.0 || sums.min_f > 0.0);
  out.gradient.resize(n + 1);
  out.hessian.resize(n + 1, n + 1);
  for (int j = 0; j < n; ++j) {
    out.gradient[j] = sums.gradient[j];
    out.hessian(j, n) = out.hessian(n, j) = sums.cross[j];
    for (int k = 0; k < n; ++k) out.hessian(j, k) = sums.hessian[j + k];
  }
  out.gradient[n] = sums.count - sums.square;
  out.hessian(n, n) = 2.0 * sums.square;
  if (!information) return;
  out.information.resize(n + 1, n + 1);
  for (int j = 0; j < n; ++j) {
    out.information(j, n) = out.information(n, j) = sums.information_cross[j];
    for (int k = 0; k < n; ++k) out.information(j, k) = sums.information[j + k];
  }
  out.information(n, n) = 2.0 * sums.count;
}

void ScaledPairs::evaluate(const Vector& x, bool information, Evaluation& out) const {
  if (streams()) {
    finish(sum(problem_, x, information, kernel_law_), x, information, out);
    return;
  }
  const int n = order_ + 1;
  if (!has_sigma(law_)) {
    Noise in_t;
    in_t.law = law_;
    in_t.parameters = x.tail(noise_count_);
    const PairsDerivatives exact = pairs_derivatives(scaled_, x.head(n), in_t);
    out.nll = exact.nll;
    out.gradient = exact.gradient;
    out.hessian = exact.hessian;
    out.information = exact.information;
  } else {
    const PairsDerivatives exact = pairs_derivatives(problem_, alpha(x), noise(x));
    Eigen::MatrixXd J = Eigen::MatrixXd::Identity(n + 1, n + 1);
    J.topLeftCorner(n, n) = shift_matrix(order_, center_, half_width_);
    out.nll = exact.nll;
    out.gradient = J.transpose() * exact.gradient;
    out.hessian = J.transpose() * exact.hessian * J;
    out.information = J.transpose() * exact.information * J;
  }
  out.valid = std::isfinite(out.nll);
}

Eigen::VectorXd ScaledPairs::alpha(const Vector& x) const {
  return shift_matrix(order_, center_, half_width_) * x.head(order_ + 1);
}

Noise ScaledPairs::noise(const Vector& x) const {
  Noise noise;
  noise.law = law_;
  if (!has_sigma(law_)) {
    noise.parameters = shift_matrix(noise_count_ - 1, center_, half_width_) * x.tail(noise_count_);
  } else {
    noise.parameters = Eigen::VectorXd::Constant(1, std::exp(x[order_ + 1]));
  }
  return noise;
}

Matrix ScaledPairs::jacobian(const Vector& x) const {
  const int n = order_ + 1;
  Matrix J = Matrix::Zero(unknowns(), unknowns());
  J.topLeftCorner(n, n) = shift_matrix(order_, center_, half_width_);
  if (!has_sigma(law_)) {
    J.bottomRightCorner(noise_count_, noise_count_) = shift_matrix(noise_count_ - 1, center_, half_width_);
  } else {
    J(n, n) = std::exp(x[n]);
  }
  return J;
}

Vector ScaledPairs::from_user(const Eigen::VectorXd& user_alpha, const Noise& user_noise) const {
  Vector x(unknowns());
  x.head(order_ + 1) =
      shift_matrix(order_, center_, half_width_).triangularView<Eigen::Upper>().solve(user_alpha);
  if (!has_sigma(law_)) {
    x.tail(noise_count_) = shift_matrix(noise_count_ - 1, center_, half_width_)
                               .triangularView<Eigen::Upper>()
                               .solve(user_noise.parameters);
  } else {
    x[order_ + 1] = std::log(user_noise.parameters[0]);
  }
  return x;
}

bool ScaledPairs::perfect(const Vector& x) const {
  // A pass over all cells is only spent where sigma is that small: s at the typical reading, in parts of it.
  if (streams() && is_power_of_f(law_)) {
    const double relative = std::exp(x[order_ + 1]) * std::pow(typical_, power_ - 1.0);
    if (relative > 1e-6) return false;
  }
  double square = 0.0, scale = 0.0;
  for (std::size_t i = 0; i < problem_.size(); ++i) {
    const double t = (problem_.true_m[i] - center_) / half_width_;
    double f = 0.0;
    for (int k = order_; k >= 0; --k) f = f * t + x[k];
    const double r = problem_.mean_m[i] - f;
    square += problem_.weight[i] * (r * r + problem_.mean_square[i]);
    scale += problem_.weight[i] * problem_.mean_m[i] * problem_.mean_m[i];
  }
  return !(square > 1e-26 * scale);  // residuals of 1e-13 of the readings: rounding
}

}  // namespace rangecal::pairs_ml
