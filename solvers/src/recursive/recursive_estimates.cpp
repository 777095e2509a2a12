// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "pairs_ml/dense_newton.hpp"
#include "pairs_ml/pairs_report.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/recursive/recursive_calibrator.hpp"
#include "robust/residual_shape.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// s(d) at sigma = 1.
Noise unit_noise(NoiseLaw law) { return {law, VectorXd::Ones(1)}; }

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

/// sum c d^-8 s^2 phi phi^T, k x k: what readings of spread s put into the normal equations of weights d^-4.
MatrixXd spread_of_weighted(const PairsProblem& cells, const Noise& noise, const VectorXd& alpha) {
  const Eigen::Index k = alpha.size();
  MatrixXd J = MatrixXd::Zero(k, k);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double d = cells.true_m[i], s = noise.spread(d, evaluate_polynomial(alpha, d));
    const VectorXd phi = powers_of(d, k);
    J += cells.count[i] * s * s * std::pow(d, -8) * phi * phi.transpose();
  }
  return J;
}

/// Standard deviation of the moment estimate x = sigma^2 over x, of residuals about a curve that was fitted with weights d^-4
/// while the spread is s: residual_spread (closed_form/residual_spread.hpp) of independent readings, whose traces are those of
/// k x k matrices. With A = sum w d^-4 phi phi^T, J = sum w d^-8 s^2 phi phi^T, K = sum w s^-2 phi phi^T, P = A^-1 J A^-1 K and N
/// readings worth one each,
///   tr T = N - 2 k + tr P,   tr(T T) = N - 2 k + tr(P P),   std(x) / x = sqrt(2 tr(T T)) / tr T.
double relative_spread(const PairsProblem& cells, const Noise& noise, const VectorXd& alpha,
                       const MatrixXd& cofactor, double readings) {
  const Eigen::Index k = alpha.size();
  const MatrixXd J = spread_of_weighted(cells, noise, alpha);
  MatrixXd K = MatrixXd::Zero(k, k);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const double d = cells.true_m[i], s = noise.spread(d, evaluate_polynomial(alpha, d));
    const VectorXd phi = powers_of(d, k);
    K += cells.count[i] / (s * s) * phi * phi.transpose();
  }
  const MatrixXd P = cofactor * J * cofactor * K;
  const double left = readings - 2.0 * static_cast<double>(k);
  return std::sqrt(2.0 * (left + (P * P).trace())) / (left + P.trace());
}

/// Whether the points may have outliers about a curve; true where it has no answer or leaves its domain.
bool may_have_outliers_about(const Calibration& curve, const PairsProblem& points) {
  if (curve.outcome != Outcome::converged) return true;
  ChannelResiduals residuals = residuals_about(curve, points.true_m, points.mean_m);
  residuals.weight = points.count;
  const auto outside = [](double s) { return !(s > 0.0); };
  return std::any_of(residuals.s.begin(), residuals.s.end(), outside) || may_have_outliers(residuals);
}

/// Whether a shape takes a point for no outlier that is next to impossible without being one, as a late reading is under early
/// echoes: the shape is of another family then.
bool is_beyond(const NoiseShapeParameters& shape, const Calibration& curve, const PairsProblem& points) {
  constexpr double impossible = 7.0;  // spreads: 3e-12 of normal errors
  const ShapeDensity density_at(shape);
  const ChannelResiduals residuals = residuals_about(curve, points.true_m, points.mean_m);
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    if (!(std::abs(residuals.z[i]) < impossible) &&
        !(density_at(residuals.z[i], residuals.s[i]).outlier > 0.5))
      return true;
  return false;
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
  while (determined < columns && std::abs(triangle_(determined, determined)) >
                                     1e-11 * triangle_.col(determined).head(determined + 1).norm())
    ++determined;
  const double factor = std::isfinite(options_.forget) ? std::exp((origin_ - now_) / options_.forget) : 1.0;
  const double W = factor * sum_w_, spare = W > 0.0 ? factor * sum_w_sq_ / sum_w_ : 1.0;
  const auto rss = [&](Eigen::Index order) {
    return factor * triangle_.col(columns).segment(order + 1, columns - order).squaredNorm();
  };
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
    result.reason =
        fmt::format("{} readings that determine {} coefficients are too few for order {} and its noise",
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
  const NoiseLaw law = !has_sigma(options_.law) ? NoiseLaw::f_squared : options_.law;
  const double variance =
      law == NoiseLaw::d_squared ? rss(order) / W : scaled_squares(cells, result.alpha, law) / dof;
  const double sigma = std::sqrt(std::max(0.0, variance));
  result.noise = {law, VectorXd::Constant(1, sigma)};
  result.noise_estimates = {
      Estimate{sigma, 0.5 * sigma * relative_spread(cells, result.noise, result.alpha, cofactor, W / spare)}};
  // (sum w d^-4 phi phi^T)^-1 sum w^2 d^-8 s^2 phi phi^T (the same)^-1, s by the law estimated; of d^2 with the
  // residuals' degrees of freedom, as the batch has it
  const double unbiased = law == NoiseLaw::d_squared ? W / dof : 1.0;
  const MatrixXd inner = spread_of_weighted(moments_.cells(factor, true), result.noise, result.alpha);
  result.alpha_covariance = unbiased * cofactor * inner * cofactor;
  result.outcome = Outcome::converged;
  return result;
}

std::optional<VectorXd> RecursiveCalibrator::noise_start(int order, VectorXd& alpha, Outcome& outcome) const {
  const double factor = std::isfinite(options_.forget) ? std::exp((origin_ - now_) / options_.forget) : 1.0;
  const PairsProblem cells = moments_.cells(factor);
  if (!has_sigma(options_.law)) {  // the polynomial that comes closest to the spread sigma f^2
    RecursiveCalibrator power(*this);
    power.options_.law = NoiseLaw::f_squared;
    const auto fit = power.maximise(order, nullptr);
    if (!fit || fit->outcome != Outcome::converged) {
      if (fit) outcome = fit->outcome;
      return std::nullopt;
    }
    alpha = fit->alpha;
    const Eigen::Index count = options_.noise_count();
    MatrixXd A = MatrixXd::Zero(count, count);
    VectorXd b = VectorXd::Zero(count);
    double square = 0.0, weights = 0.0;
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const double d = cells.true_m[i], s = fit->noise.spread(d, evaluate_polynomial(alpha, d)),
                   w = std::abs(cells.count[i]);
      const VectorXd phi = powers_of(d, count) / s;
      A += w * phi * phi.transpose();
      b += w * phi;
      square += w * s * s;
      weights += w;
    }
    VectorXd beta = A.ldlt().solve(b);
    const auto too_small = [&](double d) {
      return !(evaluate_polynomial(beta, d) > 0.1 * fit->noise.spread(d, evaluate_polynomial(alpha, d)));
    };
    if (!beta.allFinite() || std::any_of(cells.true_m.begin(), cells.true_m.end(), too_small)) {
      beta = VectorXd::Zero(count);
      beta[0] = std::sqrt(square / weights);
    }
    return beta;
  }
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
  alpha = seed.alpha;
  const double sigma = std::sqrt(scaled_squares(cells, alpha, options_.law) / (factor * sum_w_));
  if (!alpha.allFinite() || !(sigma >= 1e-13)) {
    outcome = Outcome::unbounded;
    return std::nullopt;
  }
  return VectorXd::Constant(1, sigma);
}

std::optional<Calibration> RecursiveCalibrator::maximise(int order, const Calibration* start) const {
  const double factor = std::isfinite(options_.forget) ? std::exp((origin_ - now_) / options_.forget) : 1.0;
  const PairsProblem cells = moments_.cells(factor);
  const double W = factor * sum_w_, constant = half_log_two_pi * W;
  const bool logs = has_sigma(options_.law);
  const Eigen::Index n = order + 1, m = options_.noise_count();
  Calibration result;
  VectorXd x(n + m), alpha;
  if (start) {
    x << start->alpha, logs ? VectorXd(start->noise.parameters.array().log()) : start->noise.parameters;
  } else {
    Outcome outcome = Outcome::converged;
    const auto noise = noise_start(order, alpha, outcome);
    if (outcome == Outcome::unbounded) {
      result.outcome = Outcome::unbounded;
      result.reason = "every residual can be zeroed: sigma goes to 0 and the likelihood has no maximum";
      return result;
    }
    if (!noise) return std::nullopt;
    x << alpha, logs ? VectorXd(noise->array().log()) : *noise;
  }
  const auto noise_at = [&](const VectorXd& point) {
    return Noise{options_.law, logs ? VectorXd(point.tail(m).array().exp()) : VectorXd(point.tail(m))};
  };
  const pairs_ml::DenseNewton end = pairs_ml::minimise(
      [&](const VectorXd& point) { return pairs_derivatives(cells, point.head(n), noise_at(point)); }, x);
  if (end.outcome == Outcome::failed) return std::nullopt;
  x = end.x;
  const PairsDerivatives& now = end.at;
  result.outcome = end.outcome;
  result.iterations = end.iterations;
  result.alpha = x.head(n);
  result.noise = noise_at(x);
  result.joint_nll = result.marginal_nll = now.nll + constant;
  const double spare = sum_w_ > 0.0 ? factor * sum_w_sq_ / sum_w_ : 1.0;
  result.aic = 2.0 * ((now.nll + constant) / spare + static_cast<double>(n + m));
  if (result.outcome != Outcome::converged) {
    result.reason = fmt::format("stopped after {} iterations", result.iterations);
    return result;
  }
  const PairsDerivatives squared =
      pairs_derivatives(moments_.cells(factor, true), result.alpha, result.noise);
  MatrixXd to_sigma = MatrixXd::Identity(n + m, n + m);
  if (logs) to_sigma(n, n) = result.noise.parameters[0];
  const MatrixXd inverse = to_sigma * now.information.llt().solve(MatrixXd::Identity(n + m, n + m));
  result.covariance_reason =
      "from the expected information at the estimate; the noise is not corrected for the coefficients fitted";
  pairs_ml::set_covariance(result, inverse * squared.information * inverse.transpose(), high_m_);
  return result;
}

std::optional<Calibration> RecursiveCalibrator::full_with_shape() {
  bool choose = moments_.used >= choose_at_;
  if (!choose && last_shape_.shape == NoiseShape::gaussian) return std::nullopt;
  const double factor = std::isfinite(options_.forget) ? std::exp((origin_ - now_) / options_.forget) : 1.0;
  const double worth = sum_w_ / (factor * sum_w_sq_);  // 1 / sum w^2 over sum w: weights then count readings
  const PairsProblem points = cells_.points(factor * worth, std::isfinite(options_.forget));
  PairsFit last;
  last.calibration.alpha = last_alpha_;
  last.calibration.noise = {options_.law, last_noise_};
  last.shape = last_shape_;
  const bool by_choice = options_.noise_shape == NoiseShape::automatic;
  choose = choose || (by_choice && is_beyond(last_shape_, last.calibration, points));
  PairsOptions wanted;
  wanted.order = options_.order;
  wanted.max_order = options_.max_order;
  wanted.law = options_.law;
  wanted.noise_order = options_.noise_order;
  wanted.shape = last_shape_.shape;
  std::optional<PairsFit> fit;
  std::optional<Calibration> plain;  // of Gaussian noise
  const auto converged = [&] { return fit && fit->calibration.outcome == Outcome::converged; };
  if (choose) {
    // Outliers of a stream that had none are to be seen soon; a shape that holds is chosen anew where readings have doubled.
    if (by_choice && last_shape_.shape == NoiseShape::gaussian) plain = full_gaussian();
    const bool clean = plain && !may_have_outliers_about(*plain, points);
    wanted.shape = !by_choice ? options_.noise_shape
                   : clean    ? NoiseShape::gaussian
                              : shape_of_pairs(points, wanted, stream_margin_aic);
    const double growth = wanted.shape == NoiseShape::gaussian ? 0.05 : 1.0;
    choose_at_ =
        moments_.used + std::max<std::int64_t>(1, static_cast<std::int64_t>(growth * effective_readings()));
    if (wanted.shape != NoiseShape::gaussian) fit = full_pairs(points, wanted);
  } else {
    fit = full_pairs_from(points, last, wanted);
    if (!converged()) fit = full_pairs(points, wanted);
  }
  if (wanted.shape == NoiseShape::gaussian ||
      (by_choice && !converged())) {  // a shape without an optimum is none
    last_shape_ = {};
    return plain;
  }
  Calibration result = fit->calibration;
  if (const auto shape = shape_estimate(fit->shape, fit->shape_std)) result.noise_shapes["range"] = *shape;
  if (!converged()) return result;
  last_shape_ = fit->shape;
  cells_.refer_to(result.alpha, result.noise);
  double outliers = 0.0;
  const ShapeDensity density_at(fit->shape);
  const ChannelResiduals residuals = residuals_about(result, points.true_m, points.mean_m);
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    if (density_at(residuals.z[i], residuals.s[i]).outlier > 0.5) outliers += points.count[i] / worth;
  result.outlier_count = static_cast<int>(std::lround(std::min(outliers, 2e9)));
  result.joint_nll = result.marginal_nll = *result.joint_nll / worth;
  return result;
}

Calibration RecursiveCalibrator::full() {
  std::optional<Calibration> shaped;
  if (looks_for_outliers() && approximate().outcome != Outcome::too_few_data) shaped = full_with_shape();
  Calibration result = shaped ? *shaped : full_gaussian();
  if (result.outcome == Outcome::converged) {
    last_alpha_ = result.alpha;
    last_noise_ = result.noise.parameters;
  } else if (shaped) {
    last_shape_ = {};
  }
  result.method = Method::full;
  result.kind = RecordingKind::pairs;
  result.counts = counts_;
  result.range_min_m = low_m_;
  result.range_max_m = high_m_;
  return result;
}

Calibration RecursiveCalibrator::full_gaussian() {
  std::optional<Calibration> best;
  Calibration last;
  if (last_alpha_.size() > 0) {
    last.alpha = last_alpha_;
    last.noise.parameters = last_noise_;
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
    result.reason =
        why.outcome == Outcome::converged ? "no start inside the model's domain was found" : why.reason;
  }
  return result;
}

}  // namespace rangecal
