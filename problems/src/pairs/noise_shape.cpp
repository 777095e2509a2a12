// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/noise_shape.hpp"

#include <fmt/format.h>

#include <boost/math/special_functions/digamma.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {

namespace {

constexpr auto shape_names = names_of<NoiseShape>("noise shape", {{NoiseShape::gaussian, "gaussian"},
                                                                  {NoiseShape::student_t, "student-t"},
                                                                  {NoiseShape::contaminated, "contaminated"},
                                                                  {NoiseShape::automatic, "auto"}});

}  // namespace

const char* to_string(NoiseShape shape) { return shape_names.name_of(shape); }

NoiseShape noise_shape_from_string(const std::string& text) { return shape_names.value_of(text); }

int shape_parameter_count(NoiseShape shape) {
  return shape == NoiseShape::student_t ? 1 : shape == NoiseShape::contaminated ? 2 : 0;
}

ContaminatedDensity contaminated_density(double p, double k, double z) {
  const double body = std::log1p(-p) - 0.5 * z * z, wide = std::log(p / k) - 0.5 * z * z / (k * k);
  const double high = std::fmax(body, wide);
  const double total = high + std::log(std::exp(body - high) + std::exp(wide - high));
  const double outlier = std::exp(wide - total);
  return {total, outlier, 1.0 - outlier + outlier / (k * k)};
}

ShapeDensity::ShapeDensity(const NoiseShapeParameters& shape) : shape_(shape) {
  const double nu = shape.nu;
  constant_ = -half_log_two_pi;
  if (shape.shape == NoiseShape::automatic) throw InputError("noise shape auto has no density of its own");
  if (shape.shape == NoiseShape::student_t) {
    constant_ = std::lgamma(0.5 * (nu + 1.0)) - std::lgamma(0.5 * nu) - 0.5 * std::log(nu * std::numbers::pi);
    in_nu_ = boost::math::digamma(0.5 * (nu + 1.0)) - boost::math::digamma(0.5 * nu) - 1.0 / nu;
  }
}

LogDensity ShapeDensity::operator()(double z) const {
  LogDensity out;
  if (shape_.shape == NoiseShape::student_t) {
    const double nu = shape_.nu, bend = std::log1p(z * z / nu);
    out.value = constant_ - 0.5 * (nu + 1.0) * bend;
    out.weight = (nu + 1.0) / (nu + z * z);
    out.in_shape[0] = 0.5 * (in_nu_ - bend + out.weight * z * z / nu);
  } else if (shape_.shape == NoiseShape::contaminated) {
    const double p = shape_.outlier_share, k = shape_.outlier_scale;
    const ContaminatedDensity at = contaminated_density(p, k, z);
    const double responsibility = at.outlier;
    out.value = at.log_density + constant_;
    out.weight = at.weight;
    out.in_shape[0] = responsibility / p - (1.0 - responsibility) / (1.0 - p);
    out.in_shape[1] = responsibility * (z * z / (k * k) - 1.0) / k;
  } else {
    out.value = constant_ - 0.5 * z * z;
  }
  out.derivative = -out.weight * z;
  return out;
}

LogDensity log_density(const NoiseShapeParameters& shape, double z) { return ShapeDensity(shape)(z); }

double standard_deviation(const NoiseShapeParameters& shape) {
  switch (shape.shape) {
    case NoiseShape::student_t:
      return shape.nu > 2.0 ? std::sqrt(shape.nu / (shape.nu - 2.0))
                            : std::numeric_limits<double>::infinity();
    case NoiseShape::contaminated:
      return std::sqrt(1.0 - shape.outlier_share +
                       shape.outlier_share * shape.outlier_scale * shape.outlier_scale);
    default:
      return 1.0;
  }
}

ShapeInformation shape_information(const NoiseShapeParameters& shape) {
  constexpr double step = 1.0 / 64.0, farthest = 30.0;  // z = sinh(30) = 5e12, for tails as those of nu = 1
  const ShapeDensity density_at(shape);
  const int count = 1 + shape_parameter_count(shape.shape);
  ShapeInformation information;
  information.location = information.weight = 0.0;
  information.spread = Eigen::MatrixXd::Zero(count, count);
  for (double t = 0.5 * step; t < farthest; t += step) {  // both signs alike
    const double z = std::sinh(t);
    const LogDensity at = density_at(z);
    const double mass = 2.0 * step * std::cosh(t) * std::exp(at.value);
    if (!(mass > 0.0)) continue;
    const Eigen::Vector3d score(at.weight * z * z - 1.0, at.in_shape[0], at.in_shape[1]);
    information.location += mass * at.derivative * at.derivative;
    information.weight += mass * at.weight;
    information.spread += mass * score.head(count) * score.head(count).transpose();
  }
  return information;
}

bool at_limit(const NoiseShapeParameters& shape) {
  using Limits = NoiseShapeParameters;
  if (shape.shape == NoiseShape::student_t)
    return shape.nu < 1.01 * Limits::nu_min || shape.nu > 0.95 * Limits::nu_max;
  if (shape.shape != NoiseShape::contaminated) return false;
  return shape.outlier_share < 1e-4 || shape.outlier_share > 0.489 ||
         shape.outlier_scale < Limits::scale_min + 0.01 || shape.outlier_scale > Limits::scale_max - 0.05;
}

}  // namespace rangecal
