// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/correct.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "correction/search.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

using Eigen::VectorXd;

VectorXd product(const VectorXd& a, const VectorXd& b) {
  VectorXd result = VectorXd::Zero(a.size() + b.size() - 1);
  for (Eigen::Index i = 0; i < a.size(); ++i) result.segment(i, b.size()) += a(i) * b;
  return result;
}

VectorXd derivative(const VectorXd& a) {
  VectorXd result = VectorXd::Zero(std::max<Eigen::Index>(a.size() - 1, 1));
  for (Eigen::Index i = 1; i < a.size(); ++i) result(i - 1) = static_cast<double>(i) * a(i);
  return result;
}

/// The calibration curve over the distances that are searched.
struct Curve {
  const Calibration& calibration;
  double low, high;
  std::vector<double> turning_points;  ///< f'(d) = 0 inside (low, high)

  double f(double d) const { return calibration.f(d); }
  double slope(double d) const { return calibration.slope(d); }
  double spread(double d) const { return calibration.noise.spread(d, f(d)); }

  double nll(double y, double d) const {
    const double s = spread(d), r = y - f(d);
    if (!(s > 0.0))
      return -std::numeric_limits<double>::infinity();  // no noise: the likelihood is not bounded
    return std::log(s) + r * r / (2.0 * s * s) + half_log_two_pi;
  }
  /// s'(d) along the curve.
  double spread_slope(double d) const {
    const Noise::LogSlopes log_s = calibration.noise.log_slopes(d, f(d));
    return spread(d) * (log_s.by_f * slope(d) + log_s.by_d);
  }
  /// d NLL / d d.
  double nll_slope(double y, double d) const {
    const double s = spread(d), r = y - f(d), s_slope = spread_slope(d);
    return s_slope / s - r * slope(d) / (s * s) - r * r * s_slope / (s * s * s);
  }
};

/// Distances in [low, high] of the roots of a polynomial in u, ascending.
std::vector<double> roots_over(const CurveScale& scale, const VectorXd& in_u, double low, double high) {
  if (scale.is_distance()) return real_roots(in_u, low, high);
  const auto [from, to] = std::minmax({scale.of(low), scale.of(high)});
  std::vector<double> roots = real_roots(in_u, from, to);
  for (double& root : roots) root = scale.distance(root);
  std::sort(roots.begin(), roots.end());
  return roots;
}

/// (y - f)(2 y - f) = 2 sigma^2 f^4: minima in f, inverted. q(f) = 2 sigma^2 f^4 - (y - f)(2 y - f) has the
/// sign of the slope of the NLL in f > 0, so minima are where q rises through 0.
std::vector<double> minima_f_squared(const Curve& curve, double y) {
  const double sigma = curve.calibration.noise.parameters(0);
  const double unit = std::max(1.0, y);  // q over its square: no reading is too large for it
  VectorXd q(5);
  q << -2.0 * (y / unit) * (y / unit), 3.0 * (y / unit) / unit, -1.0 / unit / unit, 0.0,
      2.0 * (sigma / unit) * (sigma / unit);
  double f_high = std::max(curve.f(curve.low), curve.f(curve.high));
  for (const double d : curve.turning_points) f_high = std::max(f_high, curve.f(d));
  std::vector<double> minima;
  if (!(f_high > 0.0)) return minima;
  for (const double f : real_roots(q, 0.0, 1.001 * f_high)) {
    if (!(evaluate_derivative(q, f) > 0.0)) continue;
    const std::vector<double> inverted = distances_at(curve.calibration, f, curve.low, curve.high);
    minima.insert(minima.end(), inverted.begin(), inverted.end());
  }
  return minima;
}

/// q(d) = sigma^2 d^4 - (y - f)(y - f + d f'/2) has the sign of the slope of the NLL in d > 0.
std::vector<double> minima_d_squared(const Curve& curve, double y) {
  const double sigma = curve.calibration.noise.parameters(0);
  const double unit = std::max(1.0, y);  // q over its square: no reading is too large for it
  VectorXd residual = -curve.calibration.alpha;
  residual(0) += y;
  VectorXd other = residual;
  for (Eigen::Index i = 0; i < other.size(); ++i)
    other(i) += 0.5 * static_cast<double>(i) * curve.calibration.alpha(i);
  residual /= unit;
  other /= unit;
  const VectorXd bracket = product(residual, other);
  VectorXd q = VectorXd::Zero(std::max<Eigen::Index>(bracket.size(), 5));
  q.head(bracket.size()) = -bracket;
  q(4) += (sigma / unit) * (sigma / unit);
  std::vector<double> minima;
  for (const double d : real_roots(q, curve.low, curve.high)) {
    if (evaluate_derivative(q, d) > 0.0) minima.push_back(d);
  }
  return minima;
}

/// Minima of the NLL between grid points, by bisection of its slope.
std::vector<double> minima_bracketed(const Curve& curve, double y, const std::vector<double>& least_squares) {
  constexpr int intervals = 400;
  std::vector<double> grid(curve.turning_points);
  for (int i = 0; i <= intervals; ++i) grid.push_back(curve.low + (curve.high - curve.low) * i / intervals);
  for (const double d : least_squares) {
    const double reach = 8.0 * curve.spread(d) / std::max(std::abs(curve.slope(d)), 1e-9);
    for (const double at : {d - reach, d + reach}) {
      if (at > curve.low && at < curve.high) grid.push_back(at);
    }
  }
  std::sort(grid.begin(), grid.end());
  std::vector<double> minima;
  for (std::size_t i = 1; i < grid.size(); ++i) {
    double a = grid[i - 1], b = grid[i];
    const double at_a = curve.nll_slope(y, a), at_b = curve.nll_slope(y, b);
    if (!(at_a < 0.0 && at_b >= 0.0)) continue;
    for (int step = 0; step < 200 && b - a > 1e-15 * b; ++step) {
      const double middle = 0.5 * (a + b);
      (curve.nll_slope(y, middle) < 0.0 ? a : b) = middle;
    }
    minima.push_back(0.5 * (a + b));
  }
  return minima;
}

/// Turning points of f at which the NLL has a minimum: its slope changes from - to + there.
void add_turning_minima(const Curve& curve, double y, std::vector<double>& minima) {
  const double step = 1e-6 * (curve.high - curve.low);
  for (const double d : curve.turning_points) {
    if (curve.nll(y, d) < curve.nll(y, d - step) && curve.nll(y, d) < curve.nll(y, d + step))
      minima.push_back(d);
  }
}

CorrectionRoot root_at(const Curve& curve, double y, double d) {
  CorrectionRoot root;
  root.distance_m = d;
  root.log_likelihood = -curve.nll(y, d);
  root.extrapolated = is_extrapolated(curve.calibration, d);
  const double slope = std::abs(curve.slope(d)), s = curve.spread(d), width = curve.high - curve.low;
  const std::optional<double> variance = curve_variance(curve.calibration, d);
  root.off = standard_deviations_off(y - curve.f(d), s, variance.value_or(0.0));
  root.turning_point = std::any_of(curve.turning_points.begin(), curve.turning_points.end(),
                                   [&](double at) { return std::abs(at - d) < 1e-7 * width; });
  if (root.turning_point || !(slope > 0.0)) return root;
  root.std_dev_m = s / slope;
  if (variance) root.std_dev_total_m = std::sqrt(s * s + *variance) / slope;
  return root;
}

/// Roots ascending, each once.
std::vector<CorrectionRoot> roots_at(const Curve& curve, double y, std::vector<double> distances) {
  std::sort(distances.begin(), distances.end());
  std::vector<CorrectionRoot> roots;
  for (const double d : distances) {
    if (!roots.empty() && d - roots.back().distance_m < 1e-9 * (curve.high - curve.low)) continue;
    roots.push_back(root_at(curve, y, d));
  }
  return roots;
}

/// argmin |f(d) - y|, where no root is in range.
double nearest_to(const Curve& curve, double y) {
  double nearest = curve.low;
  std::vector<double> candidates(curve.turning_points);
  candidates.push_back(curve.high);
  for (const double d : candidates) {
    if (is_nearer(curve.f(d), curve.f(nearest), y)) nearest = d;
  }
  return nearest;
}

Curve curve_of(const Calibration& c, const SearchedRange& range) {
  return {c, range.low, range.high, turning_points_of(c, range.low, range.high)};
}

}  // namespace

bool is_extrapolated(const Calibration& calibration, double distance_m) {
  return distance_m < calibration.range_min_m || distance_m > calibration.range_max_m;
}

int most_likely(const std::vector<CorrectionRoot>& roots) {
  int best = -1;
  for (int i = 0; i < static_cast<int>(roots.size()); ++i) {
    if (best < 0 || roots[i].log_likelihood > roots[best].log_likelihood) best = i;
  }
  return best;
}

SearchedRange searched_range(const Calibration& c, double reading_m, const CorrectionOptions& options) {
  if (!(reading_m > 0.0) || !std::isfinite(reading_m))
    throw InputError("correct: reading " + std::to_string(reading_m) + " is not a positive number");
  if (c.alpha.size() == 0) throw InputError("correct: the calibration has no alpha");
  if (c.noise.parameters.size() == 0) throw InputError("correct: the calibration has no noise parameters");
  if (!(c.range_min_m >= 0.0 && c.range_max_m > c.range_min_m && std::isfinite(c.range_max_m)))
    throw InputError("correct: the calibration's range_m is not 0 <= min < max");
  if (!(options.extension >= 0.0))
    throw InputError("correct: extension = " + std::to_string(options.extension) + " is negative");
  const double width = c.range_max_m - c.range_min_m, extra = options.extension * width;
  double low = std::max(c.range_min_m - extra, 1e-6 * width);
  if (c.scale.is_reciprocal())  // no nearer than half of the way to the curve's pole
    low = std::max(low, c.scale.distance(2.0 * c.scale.of(c.range_min_m)));
  return {low, c.range_max_m + extra};
}

std::vector<double> distances_at(const Calibration& calibration, double value, double low, double high) {
  VectorXd shifted = calibration.alpha;
  shifted(0) -= value;
  return roots_over(calibration.scale, shifted, low, high);
}

std::vector<double> turning_points_of(const Calibration& calibration, double low, double high) {
  if (calibration.alpha.size() < 2) return {};
  return roots_over(calibration.scale, derivative(calibration.alpha), low, high);
}

Correction correct(const Calibration& calibration, double reading_m, const CorrectionOptions& options) {
  const Curve curve = curve_of(calibration, searched_range(calibration, reading_m, options));
  const double y = reading_m;
  Correction result;
  const std::vector<double> least_squares = distances_at(calibration, y, curve.low, curve.high);
  result.least_squares = roots_at(curve, y, least_squares);
  result.best_least_squares = most_likely(result.least_squares);

  std::vector<double> minima;
  if (calibration.noise.law == NoiseLaw::f_squared)
    minima = minima_f_squared(curve, y);
  else if (calibration.noise.law == NoiseLaw::d_squared && calibration.scale.is_distance())
    minima = minima_d_squared(curve, y);
  else
    minima = minima_bracketed(curve, y, least_squares);
  add_turning_minima(curve, y, minima);
  std::erase_if(minima, [&](double d) { return !(curve.spread(d) > 0.0); });
  result.maximum_likelihood = roots_at(curve, y, minima);
  result.best_maximum_likelihood = most_likely(result.maximum_likelihood);

  if (!result.least_squares.empty()) {
    result.outcome = Outcome::converged;
    return result;
  }
  result.nearest = root_at(curve, y, nearest_to(curve, y));
  result.reason = "f(d) = reading has no root between " + std::to_string(curve.low) + " m and " +
                  std::to_string(curve.high) + " m; the nearest is given";
  result.outcome = result.maximum_likelihood.empty() ? Outcome::failed : Outcome::converged;
  return result;
}

double least_squares_distance(const Calibration& calibration, double reading_m,
                              const CorrectionOptions& options) {
  const Curve curve = curve_of(calibration, searched_range(calibration, reading_m, options));
  const std::vector<double> distances = distances_at(calibration, reading_m, curve.low, curve.high);
  if (distances.empty()) return nearest_to(curve, reading_m);
  return *std::min_element(distances.begin(), distances.end(), [&](double a, double b) {
    return curve.nll(reading_m, a) < curve.nll(reading_m, b);
  });
}

}  // namespace rangecal
