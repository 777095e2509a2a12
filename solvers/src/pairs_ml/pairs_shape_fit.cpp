// SPDX-License-Identifier: BSD-3-Clause
// The minimum of the row likelihood: starts, whitened rounds of BFGS, covariance.
#include <ceres/gradient_problem.h>
#include <ceres/gradient_problem_solver.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <utility>

#include "least_absolute.hpp"
#include "pairs_shape.hpp"
#include "quiet_ceres.hpp"

namespace rangecal::pairs_ml {
namespace {

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

/// Where a start came to.
struct ShapeEnd {
  Eigen::VectorXd x;
  Eigen::MatrixXd hessian;  ///< there; empty where the domain ends within a step
  double gradient_norm = std::numeric_limits<double>::infinity();  ///< whitened
  int iterations = 0;
};

/// The steps of the fit of one shape.
class ShapeFit {
 public:
  using Start = std::pair<Vector, NoiseShapeParameters>;

  ShapeFit(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law, int noise_order,
           NoiseShape shape)
      : problem_(problem),
        scaled_(scaled),
        law_(law),
        noise_order_(noise_order),
        shape_(shape),
        pairs_(problem, scaled, law, shape) {}

  std::vector<Start> starts(const Vector& gaussian, const NestedFit* nested) const;
  Eigen::VectorXd reweighted(const Start& start) const;
  ShapeEnd descend(Eigen::VectorXd from) const;
  void take(const ShapeEnd& end, double nll, ShapeResult& best) const;
  const ShapePairs& pairs() const { return pairs_; }

 private:
  ScaledPairs robust(const PairsProblem& rows) const {
    return ScaledPairs(rows, scaled_.mean_unknowns() - 1, law_, noise_order_, 65536);
  }
  Eigen::VectorXd scale_at(const Eigen::VectorXd& x) const;
  Eigen::VectorXd minimised(const Eigen::VectorXd& origin, const Eigen::MatrixXd& W, int& iterations) const;
  void add_covariance(const Eigen::MatrixXd& hessian, ShapeResult& best) const;

  const PairsProblem& problem_;
  const ScaledPairs& scaled_;
  NoiseLaw law_;
  int noise_order_;
  NoiseShape shape_;
  ShapePairs pairs_;
};

/// The Gaussian optimum, least absolute deviations of two kinds, and the fit of lower order.
std::vector<ShapeFit::Start> ShapeFit::starts(const Vector& gaussian, const NestedFit* nested) const {
  const int n = scaled_.mean_unknowns();
  std::vector<Start> starts;
  NoiseShapeParameters plain;
  plain.shape = shape_;
  starts.emplace_back(gaussian, plain);
  scale_noise(starts.back().first, n, law_, 0.6);
  for (const NoiseLaw relative_to : {NoiseLaw::constant, NoiseLaw::d_squared}) {
    if (relative_to == NoiseLaw::d_squared && !(problem_.true_m.front() > 0.0)) continue;
    const Vector found = least_absolute(problem_, scaled_, law_, relative_to, gaussian);
    if (found.size() > 0 && found.allFinite()) starts.emplace_back(found, plain);
  }
  if (nested && nested->alpha.size() > 0 && nested->alpha.size() <= n && nested->shape.shape == shape_) {
    Eigen::VectorXd alpha = Eigen::VectorXd::Zero(n);
    alpha.head(nested->alpha.size()) = nested->alpha;
    starts.emplace_back(scaled_.from_user(alpha, nested->noise), nested->shape);
  }
  return starts;
}

/// Expectation-maximisation from a start, the shape's parameters held: eight rounds of the Gaussian solver with
/// the rows' robust weights.
Eigen::VectorXd ShapeFit::reweighted(const Start& start) const {
  const auto& [begin, at] = start;
  Vector x = begin;
  for (int iteration = 0; iteration < 8; ++iteration) {
    const Eigen::VectorXd all = pairs_.internal(x, at);
    const PairsProblem rows = pairs_as_rows(problem_, pairs_.weights(all));
    const NewtonResult fit = minimise(robust(rows), x, scaled_.unknowns(), 30, 1e-6);
    if (fit.x.allFinite() && fit.outcome != Outcome::failed) x = fit.x;
  }
  return pairs_.internal(x, at);
}

/// Standard deviations of x by the expected information, those of the shape's parameters guessed.
Eigen::VectorXd ShapeFit::scale_at(const Eigen::VectorXd& x) const {
  const int first = scaled_.unknowns();
  const PairsProblem rows = pairs_as_rows(problem_, pairs_.weights(x));
  Evaluation information;
  robust(rows).evaluate(x.head(first), true, information);
  Eigen::VectorXd scale = Eigen::VectorXd::Constant(x.size(), 3.0 / std::sqrt(problem_.readings()));
  for (int j = 0; j < first; ++j)
    scale[j] = 1.0 / std::sqrt(std::fmax(information.information(j, j), 1e-300));
  return scale;
}

/// Where BFGS in u, x = origin + W u, comes to.
Eigen::VectorXd ShapeFit::minimised(const Eigen::VectorXd& origin, const Eigen::MatrixXd& W,
                                    int& iterations) const {
  auto* whitened = new Whitened(pairs_, origin, W);  // owned by the problem
  const ceres::GradientProblem program(whitened);
  ceres::GradientProblemSolver::Options options;
  options.line_search_direction_type = ceres::BFGS;
  options.max_num_iterations = 300;
  options.function_tolerance = 1e-16;
  options.gradient_tolerance = 1e-9;
  options.parameter_tolerance = 1e-15;
  options.logging_type = ceres::SILENT;
  Eigen::VectorXd u = Eigen::VectorXd::Zero(origin.size());
  ceres::GradientProblemSolver::Summary summary;
  silence_ceres();
  ceres::Solve(options, program, u.data(), &summary);
  iterations += static_cast<int>(summary.iterations.size());
  return whitened->at(u);
}

/// Up to three rounds, each whitened by the observed information of where the one before ended.
ShapeEnd ShapeFit::descend(Eigen::VectorXd from) const {
  ShapeEnd end;
  end.x = std::move(from);
  for (int round = 0; round < 3 && end.gradient_norm > 1e-7; ++round) {
    const Eigen::VectorXd scale = scale_at(end.x);
    end.hessian = difference_hessian(pairs_, end.x, scale);
    Eigen::MatrixXd W = scale.asDiagonal();
    if (end.hessian.size() > 0) {
      const Eigen::LLT<Eigen::MatrixXd> factor(end.hessian);
      if (factor.info() == Eigen::Success) W = Eigen::MatrixXd(factor.matrixU()).inverse();
    }
    const Eigen::VectorXd reached = minimised(end.x, W, end.iterations);
    Eigen::VectorXd gradient;
    const double before = pairs_.evaluate(end.x, nullptr), after = pairs_.evaluate(reached, &gradient);
    if (!(after <= before + 1e-9 * std::abs(before))) break;
    end.x = reached;
    end.gradient_norm = (W.transpose() * gradient).norm();
    end.hessian = difference_hessian(pairs_, end.x, scale);
  }
  return end;
}

/// Of x and the shape, from the observed information; none where that is not positive definite.
void ShapeFit::add_covariance(const Eigen::MatrixXd& hessian, ShapeResult& best) const {
  // A shape parameter at its limit (nu at 1 or 200, p at 0) flattens its own direction: it is held there then.
  const int first = scaled_.unknowns();
  const NoiseShapeParameters reached = pairs_.shape_at(best.x);
  best.at_limit = at_limit(reached);
  const Eigen::Index kept = best.at_limit ? first : best.x.size();
  const Eigen::MatrixXd part = hessian.topLeftCorner(kept, kept);
  if (Eigen::LLT<Eigen::MatrixXd>(part).info() != Eigen::Success) return;
  const Eigen::MatrixXd inverse = part.inverse();
  best.covariance = inverse.topLeftCorner(first, first);
  best.shape_std = deviations_of(reached, inverse.diagonal().tail(kept - first));
}

/// Makes the end of a start the best one.
void ShapeFit::take(const ShapeEnd& end, double nll, ShapeResult& best) const {
  best.x = end.x;
  best.nll = nll;
  best.gradient_norm = end.gradient_norm;
  best.iterations = end.iterations;
  best.covariance.resize(0, 0);
  best.shape_std.clear();
  Eigen::MatrixXd hessian = end.hessian;
  if (hessian.size() == 0)
    hessian = difference_hessian(pairs_, end.x, Eigen::VectorXd::Constant(end.x.size(), 1e-3));
  if (hessian.size() > 0) add_covariance(hessian, best);
  // At a kink the gradient stays; a step was taken all the same.
  const bool kink = std::isfinite(end.gradient_norm) && (hessian.size() == 0 || best.covariance.size() == 0);
  best.outcome = end.gradient_norm < 1e-3 || kink ? Outcome::converged : Outcome::not_converged;
}

}  // namespace

ShapeResult fit_shape(const PairsProblem& problem, const ScaledPairs& scaled, const Vector& gaussian,
                      NoiseLaw law, int noise_order, NoiseShape shape, const NestedFit* nested) {
  const ShapeFit fit(problem, scaled, law, noise_order, shape);
  ShapeResult best;
  best.nll = std::numeric_limits<double>::infinity();
  for (const ShapeFit::Start& start : fit.starts(gaussian, nested)) {
    Eigen::VectorXd from = fit.reweighted(start);
    if (!std::isfinite(fit.pairs().evaluate(from, nullptr))) continue;
    const ShapeEnd end = fit.descend(std::move(from));
    const double nll = fit.pairs().evaluate(end.x, nullptr);
    if (nll < best.nll) fit.take(end, nll, best);
  }
  if (std::isfinite(best.nll)) {
    best.shape = fit.pairs().shape_at(best.x);
    best.weights = fit.pairs().weights(best.x);
  }
  return best;
}

}  // namespace rangecal::pairs_ml
