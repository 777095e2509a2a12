// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace rangecal {

/// f(d) = sum_i coefficients[i] d^i  (Alhashimi 2016, eq. 3), by Horner's rule. d in metres.
template <typename Scalar, typename Coefficients>
Scalar evaluate_polynomial(const Coefficients& coefficients, const Scalar& d) {
  Scalar value(0.0);
  for (Eigen::Index i = coefficients.size(); i-- > 0;) value = value * d + coefficients[i];
  return value;
}

/// f'(d).
double evaluate_derivative(const Eigen::VectorXd& coefficients, double d);

/// 1, d, ..., d^(count - 1): the row of a polynomial in d.
Eigen::VectorXd powers_of(double d, Eigen::Index count);

/// p^T C p, p = (1, d, d^2, ...): the variance of f(d) where C is the covariance of its coefficients. By two of Horner's
/// rules; below zero by rounding only, where it is zero.
double evaluate_form(const Eigen::MatrixXd& C, double d);

/// The real roots in [low, high], ascending, of sum_i coefficients[i] d^i: closed form up to degree 2, eigenvalues
/// of the balanced companion matrix above, each polished by Newton. A double root is returned once. A polynomial
/// that vanishes identically has no roots here (there is nothing to tell).
std::vector<double> real_roots(const Eigen::VectorXd& coefficients, double low, double high);

/// The distance d [m] > 0 with f(d) = reading [m] that Newton's method leads to from d = reading, to within rounding:
///
///   d <- d - (f(d) - reading) / f'(d),   f'(d) > least_slope at every step.
///
/// For a sensor's curve, which is near f(d) = d. Nothing where f is flatter than that or falls on the way, where d is
/// not positive, and where 50 steps do not settle it: no step that is still under way is returned. Cost: some 5 steps.
std::optional<double> invert_near(const Eigen::VectorXd& coefficients, double reading,
                                  double least_slope = 0.05);

}  // namespace rangecal
