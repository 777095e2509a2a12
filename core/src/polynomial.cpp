// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/polynomial.hpp"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>

namespace rangecal {
namespace {

constexpr double kEpsilon = std::numeric_limits<double>::epsilon();

// The real roots of a + b x + c x^2 with c != 0, by the form that does not cancel. A discriminant within rounding
// of zero is a double root.
std::vector<double> quadratic_roots(double a, double b, double c) {
  const double discriminant = b * b - 4.0 * a * c;
  const double rounding = 4.0 * kEpsilon * (b * b + std::abs(4.0 * a * c));
  if (discriminant < -rounding) return {};
  if (discriminant <= rounding) return {-b / (2.0 * c)};
  const double q = -0.5 * (b + std::copysign(std::sqrt(discriminant), b));
  return {q / c, a / q};
}

// Newton from an eigenvalue; a step is taken only while it makes |p| smaller.
double polish(const Eigen::VectorXd& p, double x) {
  double value = std::abs(evaluate_polynomial(p, x));
  for (int i = 0; i < 20 && value > 0.0; ++i) {
    const double slope = evaluate_derivative(p, x);
    if (slope == 0.0) break;
    const double next = x - evaluate_polynomial(p, x) / slope;
    const double next_value = std::abs(evaluate_polynomial(p, next));
    if (!(next_value < value)) break;
    x = next;
    value = next_value;
  }
  return x;
}

// The rounding error of Horner's rule at x: |p(x)| below it cannot be told from zero.
double evaluation_error(const Eigen::VectorXd& p, double x) {
  const Eigen::VectorXd sizes = p.cwiseAbs();
  return 4.0 * static_cast<double>(p.size()) * kEpsilon * evaluate_polynomial(sizes, std::abs(x));
}

// Degree >= 3: eigenvalues of the companion matrix of the polynomial in t = x / scale, where the scale (a geometric
// mean of the roots' sizes) balances it.
std::vector<double> companion_roots(const Eigen::VectorXd& p) {
  const Eigen::Index n = p.size() - 1;
  const double scale = p[0] != 0.0 ? std::pow(std::abs(p[0] / p[n]), 1.0 / static_cast<double>(n)) : 1.0;
  Eigen::MatrixXd companion = Eigen::MatrixXd::Zero(n, n);
  companion.diagonal(-1).setOnes();
  for (Eigen::Index i = 0; i < n; ++i) {
    companion(i, n - 1) = -p[i] / p[n] * std::pow(scale, static_cast<double>(i - n));
  }
  if (!companion.allFinite()) return {};
  const Eigen::VectorXcd eigenvalues = companion.eigenvalues();

  std::vector<double> roots;
  for (const std::complex<double>& t : eigenvalues) {
    const double x = scale * t.real();
    const double tolerance = 1e-5 * (1.0 + std::abs(t));
    if (std::abs(t.imag()) > tolerance) continue;
    const double root = polish(p, x);
    // A simple real root has no imaginary part to speak of; a double one is split by rounding into a pair
    // +- sqrt(epsilon) i, and is real if p there cannot be told from zero.
    const bool simple = t.imag() == 0.0;
    if (simple || std::abs(evaluate_polynomial(p, root)) <= evaluation_error(p, root)) roots.push_back(root);
  }
  return roots;
}

}  // namespace

double evaluate_derivative(const Eigen::VectorXd& coefficients, double d) {
  double value = 0.0;
  for (Eigen::Index i = coefficients.size(); i-- > 1;)
    value = value * d + static_cast<double>(i) * coefficients[i];
  return value;
}

Eigen::VectorXd powers_of(double d, Eigen::Index count) {
  Eigen::VectorXd powers(count);
  double power = 1.0;
  for (Eigen::Index i = 0; i < count; ++i, power *= d) powers[i] = power;
  return powers;
}

double evaluate_form(const Eigen::MatrixXd& C, double d) {
  double form = 0.0;
  for (Eigen::Index i = C.rows(); i-- > 0;) {
    double row = 0.0;
    for (Eigen::Index j = C.cols(); j-- > 0;) row = row * d + C(i, j);
    form = form * d + row;
  }
  return std::max(form, 0.0);
}

std::vector<double> real_roots(const Eigen::VectorXd& coefficients, double low, double high) {
  Eigen::Index size = coefficients.size();
  while (size > 0 && coefficients[size - 1] == 0.0) --size;
  if (size <= 1 || !coefficients.allFinite()) return {};
  const Eigen::VectorXd p = coefficients.head(size);

  std::vector<double> roots;
  if (size == 2) {
    roots = {-p[0] / p[1]};
  } else if (size == 3) {
    roots = quadratic_roots(p[0], p[1], p[2]);
  } else {
    roots = companion_roots(p);
  }
  for (double& root : roots) root = polish(p, root);
  std::erase_if(roots, [&](double root) { return !(root >= low && root <= high); });
  std::sort(roots.begin(), roots.end());
  // Two that differ by less than a double root is split by rounding are one.
  const auto same = [](double a, double b) { return std::abs(a - b) <= 1e-7 * std::max(1.0, std::abs(a)); };
  roots.erase(std::unique(roots.begin(), roots.end(), same), roots.end());
  return roots;
}

std::optional<double> invert_near(const Eigen::VectorXd& coefficients, double reading, double least_slope) {
  constexpr int most_steps = 50;
  double d = reading;
  for (int i = 0; i < most_steps; ++i) {
    const double slope = evaluate_derivative(coefficients, d);
    if (!(slope > least_slope)) return std::nullopt;
    const double step = (evaluate_polynomial(coefficients, d) - reading) / slope;
    d -= step;
    // f(d) itself is known no better than its rounding
    const double rounding = (evaluation_error(coefficients, d) + kEpsilon * std::abs(reading)) / slope;
    if (!std::isfinite(d + rounding)) return std::nullopt;
    if (std::abs(step) > 1e-12 * std::abs(d) + rounding) continue;
    return d > 0.0 ? std::optional(d) : std::nullopt;
  }
  return std::nullopt;
}

}  // namespace rangecal
