// SPDX-License-Identifier: BSD-3-Clause
#include "robust/residual_shape.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/statistics/median.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using Limits = NoiseShapeParameters;
constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr int most = 4;  // log c, delta, two of the shape
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, most, 1>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, most, most>;

double logit(double p) { return std::log(p / (1.0 - p)); }

/// What scoring moves: log c, delta, then log nu; or logit(p / most) and log k; or the same and log |outlier_mean|.
struct Coordinates {
  bool location;
  NoiseShape shape;
  double typical, sign;

  double most() const {
    return shape == NoiseShape::one_sided ? Limits::one_sided_share_max : Limits::share_max;
  }
  int first_of_shape() const { return location ? 2 : 1; }
  int size() const { return first_of_shape() + shape_parameter_count(shape); }

  Vector from(const ResidualShape& at) const {
    Vector q(size());
    q[0] = std::log(at.scale);
    if (location) q[1] = at.location;
    const int i = first_of_shape();
    if (shape == NoiseShape::student_t) q[i] = std::log(at.shape.nu);
    if (shape == NoiseShape::contaminated || shape == NoiseShape::one_sided) {
      q[i] = logit(std::clamp(at.shape.outlier_share / most(), 1e-9, 1.0 - 1e-9));
      q[i + 1] = shape == NoiseShape::contaminated ? std::log(at.shape.outlier_scale)
                                                   : std::log(std::abs(at.shape.outlier_mean));
    }
    return bounded(q);
  }

  ResidualShape at(const Vector& q) const {
    ResidualShape result;
    result.shape.shape = shape;
    result.scale = std::exp(q[0]);
    if (location) result.location = q[1];
    const int i = first_of_shape();
    if (shape == NoiseShape::student_t) result.shape.nu = std::exp(q[i]);
    if (shape == NoiseShape::contaminated || shape == NoiseShape::one_sided) {
      result.shape.outlier_share = most() / (1.0 + std::exp(-q[i]));
      if (shape == NoiseShape::contaminated)
        result.shape.outlier_scale = std::exp(q[i + 1]);
      else
        result.shape.outlier_mean = sign * std::exp(q[i + 1]);
    }
    return result;
  }

  std::pair<double, double> limits(int j) const {
    const int i = first_of_shape();
    if (j < i) return {-infinity, infinity};
    if (shape == NoiseShape::student_t) return {std::log(Limits::nu_min), std::log(Limits::nu_max)};
    if (j == i) return {-14.0, 12.0};
    const double unit = shape == NoiseShape::contaminated ? 1.0 : typical;
    return {std::log(Limits::scale_min * unit), std::log(Limits::scale_max * unit)};
  }

  Vector bounded(Vector q) const {
    for (int j = 0; j < q.size(); ++j) q[j] = std::clamp(q[j], limits(j).first, limits(j).second);
    return q;
  }
};

/// The objective with its gradient and, where asked, the outer product of the scores.
struct Value {
  double nll = infinity;
  Vector gradient;
  Matrix outer;
};

Value value_at(const ChannelResiduals& residuals, const Coordinates& coordinates, const Vector& q,
               double fitted, bool with_outer) {
  const ResidualShape at = coordinates.at(q);
  const ShapeDensity density_at(at.shape);
  const int size = coordinates.size(), first = coordinates.first_of_shape();
  const double count = residuals.count(), c = at.scale;
  const double per_reading = 1.0 - fitted / count;
  double slopes[2] = {1.0, 1.0};  // of the shape's parameters in their coordinates
  if (at.shape.shape == NoiseShape::student_t) slopes[0] = at.shape.nu;
  if (size > first + 1) {
    slopes[0] = at.shape.outlier_share * (1.0 - at.shape.outlier_share / coordinates.most());
    slopes[1] = at.shape.shape == NoiseShape::contaminated ? at.shape.outlier_scale : at.shape.outlier_mean;
  }
  Value value;
  value.gradient = Vector::Zero(size);
  value.outer = Matrix::Zero(size, size);
  double sum = (count - fitted) * q[0];
  Vector score(size);
  for (std::size_t i = 0; i < residuals.z.size(); ++i) {
    const double z = (residuals.z[i] - at.location) / c;
    const LogDensity density = density_at(z, c * residuals.s[i]);
    const double w = residuals.weight_of(i);
    sum -= w * density.value;
    score[0] = -per_reading - density.derivative * z + density.in_log_s;
    if (coordinates.location) score[1] = -density.derivative / c;
    for (int j = first; j < size; ++j) score[j] = density.in_shape[j - first] * slopes[j - first];
    value.gradient -= w * score;
    if (!with_outer) continue;
    for (int j = 0; j < size; ++j)
      for (int k = 0; k <= j; ++k) value.outer(j, k) += w * score[j] * score[k];
  }
  if (with_outer) value.outer.triangularView<Eigen::StrictlyUpper>() = value.outer.transpose();
  if (at.shape.shape == NoiseShape::student_t) {
    const double nu = at.shape.nu;
    sum += 0.5 * fitted * std::log((nu + 1.0) / (nu + 3.0));
    value.gradient[first] += 0.5 * fitted * nu * (1.0 / (nu + 1.0) - 1.0 / (nu + 3.0));
  }
  value.nll = std::isfinite(sum) ? sum : infinity;
  return value;
}

/// Second derivatives by differences of the gradient; the outer product of the scores where these are not positive
/// definite, as far from the minimum. The outer product alone is nothing where a single outlier holds share and size.
Matrix curvature_at(const ChannelResiduals& residuals, const Coordinates& coordinates, const Vector& q,
                    double fitted, const Value& at) {
  constexpr double step = 1e-4;
  Matrix H(q.size(), q.size());
  for (int j = 0; j < q.size(); ++j) {
    Vector moved = q;
    const bool down = q[j] + step > coordinates.limits(j).second;
    moved[j] += down ? -step : step;
    H.col(j) = (value_at(residuals, coordinates, moved, fitted, false).gradient - at.gradient) /
               (down ? -step : step);
  }
  H = Matrix(0.5 * (H + H.transpose()));
  if (H.allFinite() && Eigen::LLT<Matrix>(H).info() == Eigen::Success) return H;
  return at.outer;
}

ResidualShape gaussian_shape(const ChannelResiduals& residuals, const ResidualShapeOptions& options) {
  const double count = residuals.count();
  ResidualShape result;
  if (options.free_location)
    for (std::size_t i = 0; i < residuals.z.size(); ++i)
      result.location += residuals.weight_of(i) * residuals.z[i] / count;
  double squares = 0.0;
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    squares += residuals.weight_of(i) * std::pow(residuals.z[i] - result.location, 2);
  const double degrees = std::max(1.0, count - options.fitted);
  result.scale = std::sqrt(std::max(squares / degrees, std::numeric_limits<double>::min()));
  result.nll = degrees * (std::log(result.scale) + 0.5) + count * half_log_two_pi;
  return result;
}

constexpr std::array of_range{NoiseShape::gaussian, NoiseShape::student_t, NoiseShape::contaminated,
                              NoiseShape::one_sided};
constexpr std::array of_bearing{NoiseShape::gaussian, NoiseShape::student_t, NoiseShape::contaminated};

}  // namespace

double ChannelResiduals::typical_spread() const { return upper_median(s, weight); }

double ChannelResiduals::count() const {
  return weight.empty() ? static_cast<double>(z.size()) : std::accumulate(weight.begin(), weight.end(), 0.0);
}

ChannelResiduals residuals_about(const Calibration& curve, std::span<const double> d,
                                 std::span<const double> y) {
  ChannelResiduals at;
  for (std::size_t i = 0; i < d.size(); ++i) {
    const double f = curve.f(d[i]);
    at.s.push_back(curve.noise.spread(d[i], f));
    at.z.push_back((y[i] - f) / at.s.back());
  }
  return at;
}

ResidualShape fit_residual_shape(const ChannelResiduals& residuals, const ResidualShape& start,
                                 const ResidualShapeOptions& options) {
  constexpr int max_iterations = 60;
  if (start.shape.shape == NoiseShape::gaussian) return gaussian_shape(residuals, options);
  SolverLog log("noise shape");
  if (log.on()) log.of(to_string(start.shape.shape));
  const Coordinates coordinates{options.free_location, start.shape.shape, residuals.typical_spread(),
                                start.shape.outlier_mean < 0.0 ? -1.0 : 1.0};
  Vector q = coordinates.from(start);
  Value at = value_at(residuals, coordinates, q, options.fitted, true);
  const char* why =
      std::isfinite(at.nll) ? "no iterations are left" : "the start is outside of the model's domain";
  int iteration = 0;
  for (; iteration < max_iterations && std::isfinite(at.nll); ++iteration) {
    Matrix curvature = curvature_at(residuals, coordinates, q, options.fitted, at);
    Vector downhill = -at.gradient;
    for (int j = 0; j < q.size(); ++j) {
      const auto [low, high] = coordinates.limits(j);
      const bool held = (q[j] <= low && downhill[j] < 0.0) || (q[j] >= high && downhill[j] > 0.0);
      if (held) {
        curvature.row(j).setZero();
        curvature.col(j).setZero();
        downhill[j] = 0.0;
      }
      curvature(j, j) += held ? 1.0 : 1e-9 * curvature(j, j) + 1e-12;
    }
    Vector step = curvature.ldlt().solve(downhill);
    const double gain = 0.5 * downhill.dot(step);
    if (!(gain > options.tolerance)) {
      why = "the next step promises next to nothing";
      break;
    }
    step *= std::min(1.0, 1.5 / step.cwiseAbs().maxCoeff());
    bool moved = false;
    for (double factor = 1.0; factor > 1e-3 && !moved; factor *= 0.4) {
      const Vector trial = coordinates.bounded(q + factor * step);
      Value next = value_at(residuals, coordinates, trial, options.fitted, true);
      if (!(next.nll < at.nll)) continue;
      moved = true;
      q = trial;
      at = std::move(next);
      log.iteration(iteration + 1, at.nll, factor * std::sqrt(2.0 * gain), std::sqrt(2.0 * gain),
                    {"length", factor});
    }
    if (!moved) {
      log.iteration(iteration + 1, at.nll, 0.0, std::sqrt(2.0 * gain), {"length", 0.0});
      why = "no step along the gradient lowers the cost";
      break;
    }
  }
  log.end(iteration, at.nll, why);
  ResidualShape result = coordinates.at(q);
  result.nll = at.nll;
  return result;
}

ResidualShape first_residual_shape(const ChannelResiduals& residuals, NoiseShape shape) {
  constexpr double far = 3.5;
  ResidualShape start;
  start.shape.shape = shape;
  std::vector<double> sizes;
  for (const double z : residuals.z) sizes.push_back(std::abs(z));
  start.scale = std::max(upper_median(sizes, residuals.weight) / median_of_normal_size,
                         std::numeric_limits<double>::min());
  const double count = residuals.count();
  double beyond = 0.0, squares = 0.0, above = 0.0, below = 0.0, reach_above = 0.0, reach_below = 0.0;
  for (std::size_t i = 0; i < residuals.z.size(); ++i) {
    const double z = residuals.z[i] / start.scale, w = residuals.weight_of(i);
    if (std::abs(z) < far) continue;
    beyond += w;
    squares += w * z * z;
    (z > 0.0 ? above : below) += w;
    (z > 0.0 ? reach_above : reach_below) += w * std::abs(residuals.z[i]) * residuals.s[i];
  }
  const bool early = reach_below > reach_above;
  if (shape == NoiseShape::one_sided) {
    beyond = early ? below : above;
    start.shape.outlier_mean =
        (early ? -reach_below : reach_above) / std::max(std::numeric_limits<double>::min(), beyond);
    if (!(beyond > 0.0)) start.shape.outlier_mean = 5.0 * start.scale * residuals.typical_spread();
  }
  start.shape.outlier_share = std::clamp(beyond / count, 0.5 / count, 0.25);
  start.shape.outlier_scale = beyond > 0.0 ? std::sqrt(squares / beyond) : 4.0;
  return start;
}

RankedShapes rank_shapes(const ChannelResiduals& residuals, std::span<const NoiseShape> shapes) {
  ResidualShapeOptions options;
  options.free_location = true;
  options.tolerance = 1e-3;
  ResidualShape gaussian;
  gaussian = fit_residual_shape(residuals, gaussian, options);
  RankedShapes ranked{{gaussian, 0.0}};
  for (const NoiseShape shape : shapes) {
    if (shape == NoiseShape::gaussian) continue;
    const ResidualShape fit = fit_residual_shape(residuals, first_residual_shape(residuals, shape), options);
    // Outliers that are as many as may be are no outliers: the body is skewed.
    if (shape == NoiseShape::one_sided && fit.shape.outlier_share > 0.95 * Limits::one_sided_share_max)
      continue;
    ranked.emplace_back(fit, 2.0 * (fit.nll - gaussian.nll + shape_parameter_count(shape)));
  }
  std::stable_sort(ranked.begin(), ranked.end(),
                   [](const auto& a, const auto& b) { return a.second < b.second; });
  return ranked;
}

bool may_have_outliers(const ChannelResiduals& residuals) {
  const double count = residuals.count();
  if (count < 8.0) return false;
  double mean = 0.0, m2 = 0.0, m3 = 0.0, m4 = 0.0, largest = 0.0;
  for (std::size_t i = 0; i < residuals.z.size(); ++i)
    mean += residuals.weight_of(i) * residuals.z[i] / count;
  for (std::size_t i = 0; i < residuals.z.size(); ++i) {
    const double u = residuals.z[i] - mean, w = residuals.weight_of(i);
    m2 += w * u * u;
    m3 += w * u * u * u;
    m4 += w * u * u * u * u;
    largest = std::max(largest, std::abs(u));
  }
  m2 /= count;
  if (!(m2 > 0.0)) return false;
  const double skew = m3 / count / std::pow(m2, 1.5), excess = m4 / count / (m2 * m2) - 3.0;
  // Score tests [nats]: of 1 / nu at 0 (excess / 4 has variance 3 / 2 per reading), of a skew (variance 6).
  constexpr double gain = 2.0;
  if (excess > 0.0 && count * excess * excess / 48.0 > gain) return true;
  if (count * skew * skew / 12.0 > gain) return true;
  return count * normal_two_sided(largest / std::sqrt(m2)) < 0.05;
}

std::span<const NoiseShape> range_shapes() { return of_range; }
std::span<const NoiseShape> bearing_shapes() { return of_bearing; }

}  // namespace rangecal
