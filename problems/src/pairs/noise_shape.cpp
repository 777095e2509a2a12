// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/noise_shape.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <boost/math/special_functions/digamma.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/sum_of_logs.hpp"

namespace rangecal {

namespace {

constexpr auto shape_names = names_of<NoiseShape>("noise shape", {{NoiseShape::gaussian, "gaussian"},
                                                                  {NoiseShape::student_t, "student-t"},
                                                                  {NoiseShape::contaminated, "contaminated"},
                                                                  {NoiseShape::one_sided, "one-sided"},
                                                                  {NoiseShape::automatic, "auto"}});

/// The contaminated normal from log(1 - p) and log(p / k).
ContaminatedDensity contaminated_at(double log_body, double log_wide, double k, double z) {
  const SumOfLogs sum = sum_of_logs(log_body - 0.5 * z * z, log_wide - 0.5 * z * z / (k * k));
  return {sum.log_sum, sum.part, 1.0 - sum.part + sum.part / (k * k)};
}

}  // namespace

const char* to_string(NoiseShape shape) { return shape_names.name_of(shape); }

NoiseShape noise_shape_from_string(const std::string& text) { return shape_names.value_of(text); }

int shape_parameter_count(NoiseShape shape) {
  switch (shape) {
    case NoiseShape::gaussian:
    case NoiseShape::automatic:
      return 0;
    case NoiseShape::student_t:
      return 1;
    case NoiseShape::contaminated:
    case NoiseShape::one_sided:
      return 2;
  }
  return 0;
}

ContaminatedDensity contaminated_density(double p, double k, double z) {
  return contaminated_at(std::log1p(-p), std::log(p / k), k, z);
}

namespace {

/// exp(t^2) erfc(t) for t >= 0; erfc alone underflows from t = 26 on.
double scaled_erfc(double t) {
  constexpr double far = 25.0;
  if (t < far) return std::exp(t * t) * std::erfc(t);
  const double v = 0.5 / (t * t);  // asymptotic series, to 945 v^5 < 4e-13
  return (1.0 - v * (1.0 - v * (3.0 - v * (15.0 - 105.0 * v)))) / (t * std::sqrt(std::numbers::pi));
}

double log_normal_below(double x) {
  const double t = -x / std::numbers::sqrt2;
  return t < 0.0 ? std::log(normal_below(x)) : std::log(0.5 * scaled_erfc(t)) - t * t;
}

/// Mean and variance of N(x, 1) cut off below 0 and above `end`; log_inside: ln of what is between.
void cut_on_both_sides(double x, double end, double log_inside, OneSidedDensity& at) {
  const auto density_at = [&](double edge) {
    return std::exp(-0.5 * edge * edge - half_log_two_pi - log_inside);
  };
  const double low = density_at(x), high = density_at(end - x), moved = low - high;
  at.mean = std::clamp(x + moved, 0.0, end);
  at.variance = std::clamp(1.0 - x * low - (end - x) * high - moved * moved, 0.0, end * end / 12.0);
}

}  // namespace

bool ends_out_of_reach(double x, double end) {
  constexpr double far = 10.0;  // beyond it a normal law has 1e-23
  return end > far && x < end - far;
}

double share_before_end(double lambda, double end) {
  return end < 40.0 * lambda ? -std::expm1(-end / lambda) : 1.0;  // beyond which it is 1 to the last bit
}

OneSidedDensity one_sided_density(double lambda, double z, double end) {
  const double x = z - 1.0 / lambda, t = -x / std::numbers::sqrt2;
  OneSidedDensity at;
  double mills = 0.0;  // phi(x) / Phi(x)
  if (t < 0.0) {
    const double Phi = normal_below(x);
    at.log_density = (0.5 / lambda - z) / lambda + std::log(Phi / lambda);
    mills = std::exp(-0.5 * x * x - half_log_two_pi) / Phi;
  } else {
    const double erfcx = scaled_erfc(t);
    at.log_density = std::log(0.5 * erfcx / lambda) - 0.5 * z * z;
    mills = std::sqrt(2.0 / std::numbers::pi) / erfcx;
  }
  at.mean = std::max(0.0, x + mills);
  at.variance = std::max(0.0, 1.0 - mills * at.mean);
  if (!std::isfinite(end)) return at;
  at.log_density -= std::log(share_before_end(lambda, end));
  if (ends_out_of_reach(x, end)) return at;
  // The larger of the two probabilities first: both are near 1 where z lies beyond the end.
  const bool beyond = x > 0.5 * end;
  const double larger = log_normal_below(beyond ? end - x : x),
               smaller = log_normal_below(beyond ? -x : x - end);
  if (!beyond && smaller - larger < -40.0) return at;
  const double log_inside = larger + std::log(-std::expm1(smaller - larger));
  at.log_density += log_inside - log_normal_below(x);
  cut_on_both_sides(x, end, log_inside, at);
  return at;
}

double one_sided_cumulative(double lambda, double z, double end) {
  const double all = normal_below(z), beyond = normal_below(z - end);
  const double density = std::exp(one_sided_density(lambda, z, end).log_density);
  return std::clamp(beyond - (all - beyond) / std::expm1(-end / lambda) - lambda * density, 0.0, 1.0);
}

ShapeDensity::ShapeDensity(const NoiseShapeParameters& shape) : shape_(shape) {
  const double nu = shape.nu;
  constant_ = -half_log_two_pi;
  switch (shape.shape) {
    case NoiseShape::automatic:
      throw InputError("noise shape auto has no density of its own");
    case NoiseShape::gaussian:
      break;
    case NoiseShape::student_t:
      constant_ = log_gamma(0.5 * (nu + 1.0)) - log_gamma(0.5 * nu) - 0.5 * std::log(nu * std::numbers::pi);
      in_nu_ = boost::math::digamma(0.5 * (nu + 1.0)) - boost::math::digamma(0.5 * nu) - 1.0 / nu;
      break;
    case NoiseShape::contaminated:
      log_body_ = std::log1p(-shape.outlier_share);
      log_wide_ = std::log(shape.outlier_share / shape.outlier_scale);
      break;
    case NoiseShape::one_sided:
      log_body_ = std::log1p(-shape.outlier_share);
      log_wide_ = std::log(shape.outlier_share);
      break;
  }
}

/// Of a body and outliers on one side of it.
LogDensity ShapeDensity::mixture(double z, double s) const {
  const double p = shape_.outlier_share, sign = shape_.outlier_mean < 0.0 ? -1.0 : 1.0;
  const double lambda = std::abs(shape_.outlier_mean) / s;
  const OneSidedDensity echo = one_sided_density(lambda, sign * z);
  const double body = log_body_ - half_log_two_pi - 0.5 * z * z, wide = log_wide_ + echo.log_density;
  const SumOfLogs sum = sum_of_logs(body, wide);
  const double r = sum.part;
  LogDensity out;
  out.value = sum.log_sum;
  out.outlier = r;
  out.shift = r * sign * echo.mean;
  out.extra_square = r * echo.variance + r * (1.0 - r) * echo.mean * echo.mean;
  out.derivative = out.shift - z;
  const double in_lambda = r * (echo.mean - lambda) / (lambda * lambda);
  out.in_log_s = -in_lambda * lambda;
  out.in_shape[0] = r / p - (1.0 - r) / (1.0 - p);
  out.in_shape[1] = sign * in_lambda / s;
  return out;
}

LogDensity ShapeDensity::operator()(double z, double s) const {
  LogDensity out;
  switch (shape_.shape) {
    case NoiseShape::student_t: {
      const double nu = shape_.nu, bend = std::log(1.0 + z * z / nu);
      out.value = constant_ - 0.5 * (nu + 1.0) * bend;
      out.weight = (nu + 1.0) / (nu + z * z);
      out.outlier = std::max(0.0, 1.0 - out.weight);
      out.in_shape[0] = 0.5 * (in_nu_ - bend + out.weight * z * z / nu);
      break;
    }
    case NoiseShape::contaminated: {
      const double p = shape_.outlier_share, k = shape_.outlier_scale;
      const ContaminatedDensity at = contaminated_at(log_body_, log_wide_, k, z);
      out.outlier = at.outlier;
      out.value = at.log_density + constant_;
      out.weight = at.weight;
      out.in_shape[0] = at.outlier / p - (1.0 - at.outlier) / (1.0 - p);
      out.in_shape[1] = at.outlier * (z * z / (k * k) - 1.0) / k;
      break;
    }
    case NoiseShape::one_sided:
      return mixture(z, s);
    case NoiseShape::gaussian:
    case NoiseShape::automatic:
      out.value = constant_ - 0.5 * z * z;
      break;
  }
  out.derivative = -out.weight * z;
  return out;
}

std::optional<ShapeEstimate> shape_estimate(const NoiseShapeParameters& shape,
                                            const std::vector<double>& deviations) {
  if (shape_parameter_count(shape.shape) == 0) return std::nullopt;
  ShapeEstimate estimate;
  estimate.family = to_string(shape.shape);
  std::vector<std::pair<const char*, double>> parameters;
  switch (shape.shape) {
    case NoiseShape::student_t:
      parameters = {{"nu", shape.nu}};
      break;
    case NoiseShape::contaminated:
      parameters = {{"outlier_share", shape.outlier_share}, {"outlier_scale", shape.outlier_scale}};
      break;
    case NoiseShape::one_sided:
      parameters = {{"outlier_share", shape.outlier_share}, {"outlier_mean", shape.outlier_mean}};
      break;
    case NoiseShape::gaussian:
    case NoiseShape::automatic:
      break;
  }
  for (std::size_t i = 0; i < parameters.size(); ++i) {
    const auto& [name, value] = parameters[i];
    estimate.parameters[name] = value;
    if (i < deviations.size() && std::isfinite(deviations[i])) estimate.std_dev[name] = deviations[i];
  }
  return estimate;
}

NoiseShapeParameters noise_shape_of(const Calibration& calibration, const std::string& channel) {
  NoiseShapeParameters shape;
  const auto found = calibration.noise_shapes.find(channel);
  if (found == calibration.noise_shapes.end()) return shape;
  const auto take = [&](const char* name, double& value) {
    const auto at = found->second.parameters.find(name);
    if (at != found->second.parameters.end()) value = at->second;
  };
  shape.shape = noise_shape_from_string(found->second.family);
  take("nu", shape.nu);
  take("outlier_share", shape.outlier_share);
  take("outlier_scale", shape.outlier_scale);
  take("outlier_mean", shape.outlier_mean);
  return shape;
}

LogDensity log_density(const NoiseShapeParameters& shape, double z, double s) {
  return ShapeDensity(shape)(z, s);
}

double standard_deviation(const NoiseShapeParameters& shape, double s) {
  const double p = shape.outlier_share;
  switch (shape.shape) {
    case NoiseShape::student_t:
      return shape.nu > 2.0 ? std::sqrt(shape.nu / (shape.nu - 2.0))
                            : std::numeric_limits<double>::infinity();
    case NoiseShape::contaminated:
      return std::sqrt(1.0 - p + p * shape.outlier_scale * shape.outlier_scale);
    case NoiseShape::one_sided:
      return std::sqrt(1.0 + p * (2.0 - p) * std::pow(shape.outlier_mean / s, 2));
    case NoiseShape::gaussian:
    case NoiseShape::automatic:
      return 1.0;
  }
  return 1.0;
}

ShapeInformation shape_information(const NoiseShapeParameters& shape, double s) {
  constexpr double step = 1.0 / 64.0, farthest = 30.0;  // z = sinh(30) = 5e12, for tails as those of nu = 1
  const ShapeDensity density_at(shape);
  const int count = 1 + shape_parameter_count(shape.shape);
  ShapeInformation information;
  information.location = information.weight = 0.0;
  information.spread = Eigen::MatrixXd::Zero(count, count);
  for (double t = 0.5 * step; t < farthest; t += step)
    for (const double z : {std::sinh(t), -std::sinh(t)}) {
      const LogDensity at = density_at(z, s);
      const double mass = step * std::cosh(t) * std::exp(at.value);
      if (!(mass > 0.0)) continue;
      const Eigen::Vector3d score(-at.derivative * z - 1.0 + at.in_log_s, at.in_shape[0], at.in_shape[1]);
      information.location += mass * at.derivative * at.derivative;
      information.weight += mass * at.weight;
      information.spread += mass * score.head(count) * score.head(count).transpose();
    }
  return information;
}

bool at_limit(const NoiseShapeParameters& shape, double s) {
  using Limits = NoiseShapeParameters;
  const double most = shape.shape == NoiseShape::one_sided ? Limits::one_sided_share_max : Limits::share_max;
  const bool share = shape.outlier_share < 1e-4 || shape.outlier_share > most - 1e-3;
  switch (shape.shape) {
    case NoiseShape::student_t:
      return shape.nu < 1.01 * Limits::nu_min || shape.nu > 0.95 * Limits::nu_max;
    case NoiseShape::contaminated:
      return share || shape.outlier_scale < Limits::scale_min + 0.01 ||
             shape.outlier_scale > 0.99 * Limits::scale_max;
    case NoiseShape::one_sided:
      return share || std::abs(shape.outlier_mean) < 1.01 * Limits::scale_min * s ||
             std::abs(shape.outlier_mean) > 0.99 * Limits::scale_max * s;
    case NoiseShape::gaussian:
    case NoiseShape::automatic:
      return false;
  }
  return false;
}

}  // namespace rangecal
