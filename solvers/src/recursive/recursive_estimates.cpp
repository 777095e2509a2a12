// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <fmt/format.h>

#include "pairs_ml/dense_newton.hpp"
#include "pairs_ml/pairs_report.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// s(d) at sigma = 1.
Noise unit_noise(NoiseLaw law) { return {law, VectorXd::Ones(1)}; }

VectorXd powers(double d, Eigen::Index count) {
  VectorXd phi(count);
  double power = 1.0;
  for (Eigen::Index i = 0; i < count; ++i, power *= d) phi[i] = power;
  return phi;
}

/// sum w (y - f)^2 / s^2 at sigma = 1.
double scaled_squares(const PairsProblem& cells, const VectorXd& alpha, NoiseLaw law) {
  const Noise shape = unit_noise(law);
  double sum = 0.0;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double f = evaluate_polynomial(alpha, cells.true_m[i]), s = shape.spread(cells.true_m[i], f);
    const double r = cells.mean_m[i] - f;
    sum += cells.weight[i] * (r * r + cells.mean_square[i]) / (s * s);
  }
  return sum;
}

}  // namespace

Calibration RecursiveCalibrator::approximate() const {
  Calibration result;
  result.method = Method::approximate;
  result.kind = RecordingKind::pairs;
  result.counts = counts_;
  result.range_min_m = low_m_;
  result.range_max_m = high_m_;
  const Eigen::Index columns = options_.columns();
  // Columns that the distances determine: a pivot that is not rounding beside its column.
  Eigen::Index determined = 0;
  while (determined < columns &&
         std::abs(triangle_(determined, determined)) > 1e-11 * triangle_.col(determined).head(determined + 1).norm())
    ++determined;
  const double factor = std::isfinite(options_.forget) ? std::exp((origin_ - now_) / options_.forget) : 1.0;
  const double W = factor * sum_w_, spare = W > 0.0 ? factor * sum_w_sq_ / sum_w_ : 1.0;
  const auto rss = [&](Eigen::Index order) { return factor * triangle_.col(columns).segment(order + 1, columns - order).squaredNorm(); };
  const auto dof_of = [&](Eigen::Index order) { return W - spare * static_cast<double>(order + 1); };
  Eigen::Index order = options_.order.value_or(0);
  if (!options_.order) {
    double lowest = std::numeric_limits<double>::infinity();
    for (Eigen::Index n = 1; n < determined && dof_of(n) > 0.0; ++n) {
      const double aic = W / spare * std::log(rss(n) / W) + 2.0 * static_cast<double>(n + 2);
      if (aic < lowest) {
        lowest = aic;
        order = n;
      }
    }
  }
  if (determined < order + 1 || !(dof_of(order) > 0.0)) {
    result.outcome = Outcome::too_few_data;
    result.reason = fmt::format("{} readings that determine {} coefficients are too few for order {} and its noise",
                                moments_.used, determined, order);
    return result;
  }
  const Eigen::Index p = order + 1;
  const auto R = triangle_.topLeftCorner(p, p).triangularView<Eigen::Upper>();
  result.alpha = R.solve(triangle_.col(columns).head(p));
  const MatrixXd root = R.solve(MatrixXd::Identity(p, p));
  const MatrixXd cofactor = root * root.transpose() / factor;
  const double dof = dof_of(order);
  const PairsProblem cells = moments_.cells(factor);
  const double variance =
      options_.law == NoiseLaw::d_squared ? rss(order) / W : scaled_squares(cells, result.alpha, options_.law) / dof;
  const double sigma = std::sqrt(std::max(0.0, variance));
  result.noise = {options_.law, VectorXd::Constant(1, sigma)};
  result.noise_estimates = {Estimate{sigma, sigma * std::sqrt(spare / (2.0 * dof))}};
  if (options_.law == NoiseLaw::d_squared) {
    result.alpha_covariance = spare * rss(order) / dof * cofactor;
  } else {
    const PairsProblem squared = moments_.cells(factor, true);
    MatrixXd inner = MatrixXd::Zero(p, p);
    for (std::size_t i = 0; i < squared.size(); ++i) {
      const double d = squared.true_m[i], s = result.noise.spread(d, evaluate_polynomial(result.alpha, d));
      const VectorXd phi = powers(d, p);
      inner += squared.count[i] * s * s * std::pow(d, -8) * phi * phi.transpose();
    }
    result.alpha_covariance = cofactor * inner * cofactor;
  }
  result.outcome = Outcome::converged;
  return result;
}

std::optional<Calibration> RecursiveCalibrator::maximise(int order, const Calibration* start) const {
  const double factor = std::isfinite(options_.forget) ? std::exp((origin_ - now_) / options_.forget) : 1.0;
  const PairsProblem cells = moments_.cells(factor);
  const double W = factor * sum_w_, constant = 0.5 * std::log(2.0 * std::numbers::pi) * W;
  Calibration result;
  const auto sigma_at = [&](const VectorXd& alpha) { return std::sqrt(scaled_squares(cells, alpha, options_.law) / W); };
  VectorXd x(order + 2);
  if (start) {
    x << start->alpha, std::log(start->noise.parameters[0]);
  } else {
    RecursiveCalibrator one(*this);
    one.options_.order = order;
    // S of a lower order: the leading columns, and the rest of the readings' column as one residual.
    const Eigen::Index p = order + 1, columns = options_.columns();
    if (p < columns) {
      MatrixXd lower = MatrixXd::Zero(p + 2, p + 1);
      lower.topLeftCorner(p, p) = triangle_.topLeftCorner(p, p);
      lower.col(p).head(p) = triangle_.col(columns).head(p);
      lower(p, p) = triangle_.col(columns).segment(p, columns - p + 1).norm();
      one.triangle_ = lower;
    }
    const Calibration seed = one.approximate();
    if (seed.outcome != Outcome::converged) return std::nullopt;
    x << seed.alpha, std::log(sigma_at(seed.alpha));
  }
  if (!x.allFinite() || std::exp(x[order + 1]) < 1e-13) {
    result.outcome = Outcome::unbounded;
    result.reason = "every residual can be zeroed: sigma goes to 0 and the likelihood has no maximum";
    return result;
  }
  const pairs_ml::DenseNewton end = pairs_ml::minimise([&](const VectorXd& point) {
    return pairs_derivatives(cells, point.head(order + 1), {options_.law, VectorXd::Constant(1, std::exp(point[order + 1]))});
  }, x);
  if (end.outcome == Outcome::failed) return std::nullopt;
  x = end.x;
  const PairsDerivatives& now = end.at;
  result.outcome = end.outcome;
  result.iterations = end.iterations;
  result.alpha = x.head(order + 1);
  result.noise = {options_.law, VectorXd::Constant(1, std::exp(x[order + 1]))};
  result.joint_nll = result.marginal_nll = now.nll + constant;
  const double spare = sum_w_ > 0.0 ? factor * sum_w_sq_ / sum_w_ : 1.0;
  result.aic = 2.0 * ((now.nll + constant) / spare + static_cast<double>(order + 2));
  if (result.outcome != Outcome::converged) {
    result.reason = fmt::format("stopped after {} iterations", result.iterations);
    return result;
  }
  const PairsDerivatives squared =
      pairs_derivatives(moments_.cells(factor, true), result.alpha, result.noise);
  MatrixXd to_sigma = MatrixXd::Identity(order + 2, order + 2);
  to_sigma(order + 1, order + 1) = result.noise.parameters[0];
  const MatrixXd inverse = to_sigma * now.information.llt().solve(MatrixXd::Identity(order + 2, order + 2));
  result.covariance_reason = "from the expected information at the estimate; the noise is not corrected for the coefficients fitted";
  pairs_ml::set_covariance(result, inverse * squared.information * inverse.transpose(), high_m_);
  return result;
}

Calibration RecursiveCalibrator::full() {
  std::optional<Calibration> best;
  Calibration last;
  if (last_alpha_.size() > 0) {
    last.alpha = last_alpha_;
    last.noise.parameters = VectorXd::Constant(1, last_sigma_);
  }
  const int low = options_.order.value_or(1), high = options_.order.value_or(options_.max_order);
  for (int order = low; order <= high; ++order) {
    std::optional<Calibration> fit;
    if (last.order() == order) fit = maximise(order, &last);
    if (!fit || fit->outcome != Outcome::converged) fit = maximise(order, nullptr);
    if (!fit) continue;
    const bool better = !best || (fit->outcome == Outcome::converged &&
                                  (best->outcome != Outcome::converged || *fit->aic < *best->aic));
    if (better) best = fit;
  }
  Calibration result = best.value_or(Calibration{});
  if (!best) {
    const Calibration why = approximate();
    result.outcome = why.outcome == Outcome::converged ? Outcome::failed : why.outcome;
    result.reason = why.outcome == Outcome::converged ? "no start inside the model's domain was found" : why.reason;
  }
  result.method = Method::full;
  result.kind = RecordingKind::pairs;
  result.counts = counts_;
  result.range_min_m = low_m_;
  result.range_max_m = high_m_;
  if (result.outcome == Outcome::converged) {
    last_alpha_ = result.alpha;
    last_sigma_ = result.noise.parameters[0];
  }
  return result;
}

}  // namespace rangecal
