// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_shape.hpp"

#include <ceres/gradient_problem.h>
#include <ceres/gradient_problem_solver.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include "quiet_ceres.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal::pairs_ml {
namespace {

constexpr double width = NoiseShapeParameters::scale_max - NoiseShapeParameters::scale_min;
double logistic(double u) { return 1.0 / (1.0 + std::exp(-u)); }
double logit(double p) { return std::log(p / (1.0 - p)); }

/// The objective in whitened coordinates u, x = origin + W u.
class Whitened : public ceres::FirstOrderFunction {
 public:
  Whitened(const ShapePairs& pairs, Eigen::VectorXd origin, Eigen::MatrixXd W)
      : pairs_(pairs), origin_(std::move(origin)), W_(std::move(W)) {}
  bool Evaluate(const double* const u, double* cost, double* gradient) const override {
    const Eigen::VectorXd x = at(Eigen::Map<const Eigen::VectorXd>(u, origin_.size()));
    Eigen::VectorXd in_x;
    *cost = pairs_.evaluate(x, gradient ? &in_x : nullptr);
    if (!std::isfinite(*cost)) return false;
    if (gradient) Eigen::Map<Eigen::VectorXd>(gradient, origin_.size()) = W_.transpose() * in_x;
    return true;
  }
  int NumParameters() const override { return static_cast<int>(origin_.size()); }
  Eigen::VectorXd at(const Eigen::VectorXd& u) const { return origin_ + W_ * u; }

 private:
  const ShapePairs& pairs_;
  Eigen::VectorXd origin_;
  Eigen::MatrixXd W_;
};

/// Observed information by central differences of the exact gradient; step in units of `scale`.
Eigen::MatrixXd difference_hessian(const ShapePairs& pairs, const Eigen::VectorXd& x,
                                   const Eigen::VectorXd& scale) {
  const Eigen::Index size = x.size();
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd above, below;
  for (Eigen::Index j = 0; j < size; ++j) {
    const double step = 1e-3 * scale[j];
    Eigen::VectorXd high = x, low = x;
    high[j] += step;
    low[j] -= step;
    if (!std::isfinite(pairs.evaluate(high, &above)) || !std::isfinite(pairs.evaluate(low, &below)))
      return {};
    hessian.col(j) = (above - below) / (2.0 * step);
  }
  return 0.5 * (hessian + hessian.transpose());
}

/// Standard deviations of nu, or of p and k, from the variances of what the solver moves (ShapePairs); none for none.
std::vector<double> deviations_of(const NoiseShapeParameters& shape, const Eigen::VectorXd& variances) {
  std::vector<double> out;
  for (const double variance : variances) {
    double slope = shape.nu - NoiseShapeParameters::nu_min;
    if (shape.shape == NoiseShape::contaminated) {
      const double a = 2.0 * shape.outlier_share,
                   b = (shape.outlier_scale - NoiseShapeParameters::scale_min) / width;
      slope = out.empty() ? 0.5 * a * (1.0 - a) : width * b * (1.0 - b);
    }
    out.push_back(slope * std::sqrt(variance));
  }
  return out;
}

void scale_noise(Vector& x, int first, NoiseLaw law, double factor) {
  if (law == NoiseLaw::polynomial) {
    x.tail(x.size() - first) *= factor;
  } else {
    x[first] += std::log(factor);
  }
}

/// Least absolute deviations, in metres (relative_to constant) or parts of d^2 (d_squared), by reweighted least
/// squares; the noise from the median deviation.
/// Empty where f leaves the domain of the law.
Vector least_absolute(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law,
                      NoiseLaw relative_to, const Vector& gaussian) {
  const int n = scaled.mean_unknowns();
  const std::size_t size = problem.row_true_m.size();
  PairsProblem rows = pairs_as_rows(problem);
  rows.single = false;
  Vector c;
  std::vector<double> deviation(size), sorted;
  for (int iteration = 0; iteration < 30; ++iteration) {
    const ScaledPairs plain(rows, n - 1, relative_to, 0, 1 << 30);
    Vector x;
    if (!plain.quick_seed(x)) x = plain.seed();
    if (!x.allFinite()) return {};
    c = x.head(n);
    const Eigen::VectorXd alpha = plain.alpha(x);
    for (std::size_t i = 0; i < size; ++i) {
      const double d = problem.row_true_m[i];
      deviation[i] = std::abs(problem.row_reading_m[i] - evaluate_polynomial(alpha, d));
      if (relative_to == NoiseLaw::d_squared) deviation[i] /= d * d;
    }
    sorted = deviation;
    const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(size / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    const double median = std::max(*middle, 1e-12);
    for (std::size_t i = 0; i < size; ++i) rows.weight[i] = 1.0 / std::max(deviation[i] / median, 0.05);
  }
  Vector x = gaussian;
  x.head(n) = c;
  x.tail(x.size() - n).setZero();
  if (law == NoiseLaw::polynomial) x[n] = 1.0;  // sigma = 1, or a constant spread of 1 m, to be scaled
  const Eigen::VectorXd alpha = scaled.alpha(x);
  const Noise unit = scaled.noise(x);
  for (std::size_t i = 0; i < size; ++i) {  // now in units of the law's spread
    const double f = evaluate_polynomial(alpha, problem.row_true_m[i]);
    deviation[i] = std::abs(problem.row_reading_m[i] - f);
    if (unit.power_of_f() > 0 && !(f > 0.0)) return {};
    deviation[i] /= unit.spread(problem.row_true_m[i], f);
  }
  std::nth_element(deviation.begin(), deviation.begin() + static_cast<std::ptrdiff_t>(size / 2),
                   deviation.end());
  scale_noise(x, n, law, 1.4826 * std::max(deviation[size / 2], 1e-12));
  return x;
}

}  // namespace

NoiseShapeParameters ShapePairs::shape_at(const Eigen::VectorXd& x) const {
  NoiseShapeParameters shape;
  shape.shape = shape_;
  const int first = scaled_.unknowns();
  if (shape_ == NoiseShape::student_t) shape.nu = NoiseShapeParameters::nu_min + std::exp(x[first]);
  if (shape_ == NoiseShape::contaminated) {
    shape.outlier_share = 0.5 * logistic(x[first]);
    shape.outlier_scale = NoiseShapeParameters::scale_min + width * logistic(x[first + 1]);
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
    all[first + 1] =
        logit(std::clamp((shape.outlier_scale - NoiseShapeParameters::scale_min) / width, 1e-3, 0.999));
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
    const LogDensity density = density_at(z);
    nll += std::log(s) - density.value;
    if (!gradient) continue;
    const double in_log_s = 1.0 + density.derivative * z;  // d/dlog s of log s - log g, dz/dlog s = -z
    const double in_f = density.derivative / s + (power > 0.0 ? in_log_s * power / f : 0.0);
    double power_of_d = 1.0;
    for (int j = 0; j < n; ++j, power_of_d *= d) in_user[j] += in_f * power_of_d;
    double in_parameter = law_ == NoiseLaw::polynomial ? in_log_s / s : in_log_s;
    for (int j = 0; j < m; ++j, in_parameter *= d) in_user[n + j] += in_parameter;
    in_shape[0] -= density.in_shape[0];
    in_shape[1] -= density.in_shape[1];
  }
  if (!std::isfinite(nll)) return infinity;
  if (gradient) {
    Eigen::MatrixXd J = scaled_.jacobian(gaussian);
    if (law_ != NoiseLaw::polynomial) J(n, n) = 1.0;  // the sums above are in log sigma already
    gradient->resize(unknowns());
    gradient->head(first) = J.transpose() * in_user;
    if (shape_ == NoiseShape::student_t) (*gradient)[first] = in_shape[0] * (shape.nu - 1.0);
    if (shape_ == NoiseShape::contaminated) {
      const double a = logistic(x[first]), b = logistic(x[first + 1]);
      (*gradient)[first] = in_shape[0] * 0.5 * a * (1.0 - a);
      (*gradient)[first + 1] = in_shape[1] * width * b * (1.0 - b);
    }
  }
  return nll;
}

std::vector<double> ShapePairs::weights(const Eigen::VectorXd& x) const {
  const NoiseShapeParameters shape = shape_at(x);
  const Vector gaussian = x.head(scaled_.unknowns());
  const Eigen::VectorXd alpha = scaled_.alpha(gaussian);
  const Noise noise = scaled_.noise(gaussian);
  const ShapeDensity density_at(shape);
  std::vector<double> out;
  for (std::size_t i = 0; i < problem_.row_true_m.size(); ++i) {
    const double d = problem_.row_true_m[i], f = evaluate_polynomial(alpha, d);
    out.push_back(density_at((problem_.row_reading_m[i] - f) / noise.spread(d, f)).weight);
  }
  return out;
}

ShapeResult fit_shape(const PairsProblem& problem, const ScaledPairs& scaled, const Vector& gaussian,
                      NoiseLaw law, int noise_order, NoiseShape shape, const NestedFit* nested) {
  const ShapePairs pairs(problem, scaled, law, shape);
  const int n = scaled.mean_unknowns(), first = scaled.unknowns(), order = n - 1;
  const auto weighted_step = [&](const std::vector<double>& weights, Vector& x) {
    const PairsProblem rows = pairs_as_rows(problem, weights);
    const ScaledPairs robust(rows, order, law, noise_order, 65536);
    const NewtonResult fit = minimise(robust, x, first, 30, 1e-6);
    if (fit.x.allFinite() && fit.outcome != Outcome::failed) x = fit.x;
  };

  std::vector<std::pair<Vector, NoiseShapeParameters>> starts;
  NoiseShapeParameters plain;
  plain.shape = shape;
  starts.emplace_back(gaussian, plain);
  scale_noise(starts.back().first, n, law, 0.6);
  for (const NoiseLaw relative_to : {NoiseLaw::constant, NoiseLaw::d_squared}) {
    if (relative_to == NoiseLaw::d_squared && !(problem.true_m.front() > 0.0)) continue;
    const Vector robust = least_absolute(problem, scaled, law, relative_to, gaussian);
    if (robust.size() > 0 && robust.allFinite()) starts.emplace_back(robust, plain);
  }
  if (nested && nested->alpha.size() > 0 && nested->alpha.size() <= n && nested->shape.shape == shape) {
    Eigen::VectorXd alpha = Eigen::VectorXd::Zero(n);
    alpha.head(nested->alpha.size()) = nested->alpha;
    starts.emplace_back(scaled.from_user(alpha, nested->noise), nested->shape);
  }

  ShapeResult best;
  best.nll = std::numeric_limits<double>::infinity();
  for (const auto& [start, at] : starts) {
    Vector x = start;
    for (int iteration = 0; iteration < 8; ++iteration) {
      const Eigen::VectorXd all = pairs.internal(x, at);
      weighted_step(pairs.weights(all), x);
    }
    Eigen::VectorXd all = pairs.internal(x, at);
    const double start_nll = pairs.evaluate(all, nullptr);
    if (!std::isfinite(start_nll)) continue;

    // Twice, the second time whitened by the observed information of where the first ended.
    int iterations = 0;
    double norm = std::numeric_limits<double>::infinity();
    Eigen::MatrixXd hessian;
    for (int round = 0; round < 3 && norm > 1e-7; ++round) {
      const PairsProblem rows = pairs_as_rows(problem, pairs.weights(all));
      const ScaledPairs robust(rows, order, law, noise_order, 65536);
      Evaluation information;
      robust.evaluate(all.head(first), true, information);
      Eigen::VectorXd scale = Eigen::VectorXd::Constant(all.size(), 3.0 / std::sqrt(problem.readings()));
      for (int j = 0; j < first; ++j)
        scale[j] = 1.0 / std::sqrt(std::fmax(information.information(j, j), 1e-300));
      hessian = difference_hessian(pairs, all, scale);
      Eigen::MatrixXd W = scale.asDiagonal();
      if (hessian.size() > 0) {
        const Eigen::LLT<Eigen::MatrixXd> factor(hessian);
        if (factor.info() == Eigen::Success) W = Eigen::MatrixXd(factor.matrixU()).inverse();
      }
      auto* whitened = new Whitened(pairs, all, W);  // owned by the problem
      const ceres::GradientProblem program(whitened);
      ceres::GradientProblemSolver::Options options;
      options.line_search_direction_type = ceres::BFGS;
      options.max_num_iterations = 300;
      options.function_tolerance = 1e-16;
      options.gradient_tolerance = 1e-9;
      options.parameter_tolerance = 1e-15;
      options.logging_type = ceres::SILENT;
      Eigen::VectorXd u = Eigen::VectorXd::Zero(all.size());
      ceres::GradientProblemSolver::Summary summary;
      silence_ceres();
      ceres::Solve(options, program, u.data(), &summary);
      const Eigen::VectorXd reached = whitened->at(u);
      Eigen::VectorXd gradient;
      const double before = pairs.evaluate(all, nullptr), after = pairs.evaluate(reached, &gradient);
      iterations += static_cast<int>(summary.iterations.size());
      if (!(after <= before + 1e-9 * std::abs(before))) break;
      all = reached;
      norm = (W.transpose() * gradient).norm();
      hessian = difference_hessian(pairs, all, scale);
    }
    const double nll = pairs.evaluate(all, nullptr);
    if (!(nll < best.nll)) continue;
    best.x = all;
    best.nll = nll;
    best.gradient_norm = norm;
    best.iterations = iterations;
    best.covariance.resize(0, 0);
    best.shape_std.clear();
    if (hessian.size() == 0) {
      Eigen::VectorXd scale = Eigen::VectorXd::Constant(all.size(), 1e-3);
      hessian = difference_hessian(pairs, all, scale);
    }
    if (hessian.size() > 0) {
      // A shape parameter at its limit (nu at 1 or 200, p at 0) flattens its own direction: it is held there then.
      const NoiseShapeParameters reached = pairs.shape_at(all);
      best.at_limit = at_limit(reached);
      const Eigen::Index kept = best.at_limit ? first : all.size();
      const Eigen::MatrixXd part = hessian.topLeftCorner(kept, kept);
      if (Eigen::LLT<Eigen::MatrixXd>(part).info() == Eigen::Success) {
        const Eigen::MatrixXd inverse = part.inverse();
        best.covariance = inverse.topLeftCorner(first, first);
        best.shape_std = deviations_of(reached, inverse.diagonal().tail(kept - first));
      }
    }
    // At a kink the gradient stays; a step was taken all the same.
    const bool kink = std::isfinite(norm) && (hessian.size() == 0 || best.covariance.size() == 0);
    best.outcome = norm < 1e-3 || kink ? Outcome::converged : Outcome::not_converged;
  }
  if (std::isfinite(best.nll)) {
    best.shape = pairs.shape_at(best.x);
    best.weights = pairs.weights(best.x);
  }
  return best;
}

}  // namespace rangecal::pairs_ml
