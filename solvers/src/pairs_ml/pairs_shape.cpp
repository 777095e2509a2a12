// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_shape.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "rangecal/core/polynomial.hpp"

namespace rangecal::pairs_ml {
namespace {

/// log k lies between log 3 and log 1000.
const double width = std::log(NoiseShapeParameters::scale_max / NoiseShapeParameters::scale_min);
double logistic(double u) { return 1.0 / (1.0 + std::exp(-u)); }
double logit(double p) { return std::log(p / (1.0 - p)); }

}  // namespace

NoiseShapeParameters ShapePairs::shape_at(const Eigen::VectorXd& x) const {
  NoiseShapeParameters shape;
  shape.shape = shape_;
  const int first = scaled_.unknowns();
  if (shape_ == NoiseShape::student_t) shape.nu = NoiseShapeParameters::nu_min + std::exp(x[first]);
  if (shape_ == NoiseShape::contaminated) {
    shape.outlier_share = 0.5 * logistic(x[first]);
    shape.outlier_scale = NoiseShapeParameters::scale_min * std::exp(width * logistic(x[first + 1]));
  }
  if (shape_ == NoiseShape::one_sided) {
    shape.outlier_share = 0.5 * logistic(x[first]);
    shape.outlier_mean = sign_ * std::exp(x[first + 1]);
  }
  return shape;
}

Eigen::VectorXd ShapePairs::internal(const Vector& x, const NoiseShapeParameters& shape) const {
  Eigen::VectorXd all(unknowns());
  const int first = scaled_.unknowns();
  all.head(first) = x;
  if (shape_ == NoiseShape::student_t) all[first] = std::log(shape.nu - NoiseShapeParameters::nu_min);
  if (shape_ == NoiseShape::contaminated) {
    all[first] = logit(std::clamp(2.0 * shape.outlier_share, 1e-4, 1.0 - 1e-4));
    all[first + 1] = logit(
        std::clamp(std::log(shape.outlier_scale / NoiseShapeParameters::scale_min) / width, 1e-3, 0.999));
  }
  if (shape_ == NoiseShape::one_sided) {
    all[first] = logit(std::clamp(2.0 * shape.outlier_share, 1e-4, 1.0 - 1e-4));
    all[first + 1] = std::log(std::abs(shape.outlier_mean));
  }
  return all;
}

double ShapePairs::evaluate(const Eigen::VectorXd& x, Eigen::VectorXd* gradient) const {
  const double infinity = std::numeric_limits<double>::infinity();
  if (!x.allFinite()) return infinity;
  const NoiseShapeParameters shape = shape_at(x);
  if (shape.shape == NoiseShape::student_t &&
      (shape.nu > NoiseShapeParameters::nu_max || !(shape.nu > 1.0))) {
    return infinity;
  }
  const int n = scaled_.mean_unknowns(), first = scaled_.unknowns(), m = first - n;
  const Vector gaussian = x.head(first);
  const Eigen::VectorXd alpha = scaled_.alpha(gaussian);
  const Noise noise = scaled_.noise(gaussian);
  const double power = noise.power_of_f();
  Eigen::VectorXd in_user = Eigen::VectorXd::Zero(first);
  double in_shape[2] = {0.0, 0.0}, nll = 0.0;
  const ShapeDensity density_at(shape);
  for (std::size_t i = 0; i < problem_.row_true_m.size(); ++i) {
    const double d = problem_.row_true_m[i];
    const double f = evaluate_polynomial(alpha, d);
    const double s = noise.spread(d, f);
    if (!(s > 0.0) || (power > 0.0 && !(f > 0.0))) return infinity;
    const double z = (problem_.row_reading_m[i] - f) / s;
    const LogDensity density = density_at(z, s);
    const double w = problem_.weight_of_row(i);
    nll += w * (std::log(s) - density.value);
    if (!gradient) continue;
    // d/dlog s of log s - log g, dz/dlog s = -z
    const double in_log_s = w * (1.0 + density.derivative * z - density.in_log_s);
    const double in_f = w * density.derivative / s + (power > 0.0 ? in_log_s * power / f : 0.0);
    double power_of_d = 1.0;
    for (int j = 0; j < n; ++j, power_of_d *= d) in_user[j] += in_f * power_of_d;
    double in_parameter = !has_sigma(law_) ? in_log_s / s : in_log_s;
    for (int j = 0; j < m; ++j, in_parameter *= d) in_user[n + j] += in_parameter;
    in_shape[0] -= w * density.in_shape[0];
    in_shape[1] -= w * density.in_shape[1];
  }
  if (!std::isfinite(nll)) return infinity;
  if (gradient) {
    Eigen::MatrixXd J = scaled_.jacobian(gaussian);
    if (has_sigma(law_)) J(n, n) = 1.0;  // the sums above are in log sigma already
    gradient->resize(unknowns());
    gradient->head(first) = J.transpose() * in_user;
    if (shape_ == NoiseShape::student_t) (*gradient)[first] = in_shape[0] * (shape.nu - 1.0);
    if (shape_ == NoiseShape::contaminated) {
      const double a = logistic(x[first]), b = logistic(x[first + 1]);
      (*gradient)[first] = in_shape[0] * 0.5 * a * (1.0 - a);
      (*gradient)[first + 1] = in_shape[1] * shape.outlier_scale * width * b * (1.0 - b);
    }
    if (shape_ == NoiseShape::one_sided) {
      const double a = logistic(x[first]);
      (*gradient)[first] = in_shape[0] * 0.5 * a * (1.0 - a);
      (*gradient)[first + 1] = in_shape[1] * shape.outlier_mean;
    }
  }
  return nll;
}

ChannelResiduals ShapePairs::residuals(const Eigen::VectorXd& x) const {
  const Vector gaussian = x.head(scaled_.unknowns());
  const Eigen::VectorXd alpha = scaled_.alpha(gaussian);
  const Noise noise = scaled_.noise(gaussian);
  ChannelResiduals at;
  at.weight = problem_.row_weight;
  for (std::size_t i = 0; i < problem_.row_true_m.size(); ++i) {
    const double d = problem_.row_true_m[i], f = evaluate_polynomial(alpha, d);
    at.s.push_back(noise.spread(d, f));
    at.z.push_back((problem_.row_reading_m[i] - f) / at.s.back());
  }
  return at;
}

std::vector<double> ShapePairs::weights(const Eigen::VectorXd& x) const {
  const ShapeDensity density_at(shape_at(x));
  const ChannelResiduals at = residuals(x);
  std::vector<double> out;
  for (std::size_t i = 0; i < at.z.size(); ++i) {
    const LogDensity density = density_at(at.z[i], at.s[i]);
    out.push_back(shape_ == NoiseShape::one_sided ? 1.0 - density.outlier : density.weight);
  }
  return out;
}

std::vector<double> deviations_of(const NoiseShapeParameters& shape, const Eigen::VectorXd& variances) {
  std::vector<double> out;
  for (const double variance : variances) {
    double slope = shape.nu - NoiseShapeParameters::nu_min;
    if (shape.shape == NoiseShape::contaminated) {
      const double a = 2.0 * shape.outlier_share,
                   b = std::log(shape.outlier_scale / NoiseShapeParameters::scale_min) / width;
      slope = out.empty() ? 0.5 * a * (1.0 - a) : shape.outlier_scale * width * b * (1.0 - b);
    }
    if (shape.shape == NoiseShape::one_sided)
      slope = out.empty() ? shape.outlier_share * (1.0 - 2.0 * shape.outlier_share)
                          : std::abs(shape.outlier_mean);
    out.push_back(slope * std::sqrt(variance));
  }
  return out;
}

}  // namespace rangecal::pairs_ml
