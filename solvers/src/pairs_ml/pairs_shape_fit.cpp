// SPDX-License-Identifier: BSD-3-Clause
// The minimum of the row likelihood: starts, BFGS, covariance.
#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "least_absolute.hpp"
#include "pairs_shape.hpp"
#include "solver_log.hpp"

namespace rangecal::pairs_ml {
namespace {

/// Observed information by central differences of the exact gradient, or by one-sided ones from that at x; step in units of
/// `scale`.
Eigen::MatrixXd difference_hessian(const ShapePairs& pairs, const Eigen::VectorXd& x,
                                   const Eigen::VectorXd& scale, const Eigen::VectorXd* at_x = nullptr) {
  const Eigen::Index size = x.size();
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd above, below;
  for (Eigen::Index j = 0; j < size; ++j) {
    const double step = 1e-3 * scale[j];
    Eigen::VectorXd high = x, low = x;
    high[j] += step;
    low[j] -= step;
    if (!std::isfinite(pairs.evaluate(high, &above))) return {};
    if (!at_x && !std::isfinite(pairs.evaluate(low, &below))) return {};
    hessian.col(j) =
        at_x ? Eigen::VectorXd((above - *at_x) / step) : Eigen::VectorXd((above - below) / (2.0 * step));
  }
  return 0.5 * (hessian + hessian.transpose());
}

/// Where a start came to.
struct ShapeEnd {
  Eigen::VectorXd x;
  Eigen::MatrixXd hessian;  ///< there; empty where the domain ends within a step
  double gradient_norm = std::numeric_limits<double>::infinity();  ///< sqrt(g^T H^-1 g)
  int iterations = 0;
};

/// The steps of the fit of one shape.
class ShapeFit {
 public:
  using Start = std::pair<Vector, NoiseShapeParameters>;

  /// `first`: what the shape starts at; the sign of its outlier_mean is kept.
  ShapeFit(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law, int noise_order,
           const NoiseShapeParameters& first)
      : problem_(problem),
        scaled_(scaled),
        law_(law),
        noise_order_(noise_order),
        first_(first),
        pairs_(problem, scaled, law, first.shape, first.outlier_mean < 0.0) {}

  std::vector<Start> starts(const Vector& gaussian, const NestedFit* nested) const;
  Eigen::VectorXd reweighted(const Start& start) const;
  /// `near`: the optimum is within a standard deviation, where the curvature is that at the start.
  ShapeEnd descend(Eigen::VectorXd from, bool near = false) const;
  void take(const ShapeEnd& end, double nll, ShapeResult& best) const;
  const ShapePairs& pairs() const { return pairs_; }

 private:
  ScaledPairs robust(const PairsProblem& rows) const {
    return ScaledPairs(rows, scaled_.mean_unknowns() - 1, law_, noise_order_, 65536);
  }
  Eigen::VectorXd scale_at(const Eigen::VectorXd& x) const;
  void add_covariance(const Eigen::MatrixXd& hessian, ShapeResult& best) const;

  const PairsProblem& problem_;
  const ScaledPairs& scaled_;
  NoiseLaw law_;
  int noise_order_;
  NoiseShapeParameters first_;
  ShapePairs pairs_;
};

/// The Gaussian optimum, least absolute deviations of two kinds, and the fit of lower order.
std::vector<ShapeFit::Start> ShapeFit::starts(const Vector& gaussian, const NestedFit* nested) const {
  const int n = scaled_.mean_unknowns();
  std::vector<Start> starts;
  starts.emplace_back(gaussian, first_);
  scale_noise(starts.back().first, n, law_, 0.6);
  for (const NoiseLaw relative_to : {NoiseLaw::constant, NoiseLaw::d_squared}) {
    if (relative_to == NoiseLaw::d_squared && !(problem_.true_m.front() > 0.0)) continue;
    const Vector found = least_absolute(problem_, scaled_, law_, relative_to, gaussian);
    if (found.size() > 0 && found.allFinite()) starts.emplace_back(found, first_);
  }
  if (nested && nested->alpha.size() > 0 && nested->alpha.size() <= n &&
      nested->shape.shape == first_.shape &&
      (first_.shape != NoiseShape::one_sided || nested->shape.outlier_mean * first_.outlier_mean > 0.0)) {
    Eigen::VectorXd alpha = Eigen::VectorXd::Zero(n);
    alpha.head(nested->alpha.size()) = nested->alpha;
    starts.emplace_back(scaled_.from_user(alpha, nested->noise), nested->shape);
  }
  return starts;
}

/// Expectation-maximisation from a start, the shape's parameters held: eight iterations of the Gaussian solver with
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

/// |H|^-1 by the eigenvectors in units of `scale`: along a direction of negative or no curvature its size stands in, at
/// least a ten-thousandth of the largest (a share that goes to 0 leaves the likelihood flat along it).
Eigen::MatrixXd inverse_curvature(const Eigen::MatrixXd& hessian, const Eigen::VectorXd& scale) {
  if (hessian.size() == 0 || !hessian.allFinite()) return scale.cwiseAbs2().asDiagonal();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(scale.asDiagonal() * hessian *
                                                             scale.asDiagonal());
  const Eigen::VectorXd size = eigen.eigenvalues().cwiseAbs();
  const double least = std::max(1e-4 * size.maxCoeff(), 1e-300);
  const Eigen::MatrixXd root = scale.asDiagonal() * eigen.eigenvectors() *
                               size.cwiseMax(least).cwiseSqrt().cwiseInverse().asDiagonal();
  return root * root.transpose();
}

/// Up to three iterations of BFGS, each from the observed information (by differences of the exact gradient) of where the one
/// before ended.
ShapeEnd ShapeFit::descend(Eigen::VectorXd from, bool near) const {
  constexpr int iterations = 3, most = 100;
  constexpr double close = 1e-7, rounding = 1e-14;
  const SolverLog log("pairs shape");
  ShapeEnd end;
  end.x = std::move(from);
  Eigen::VectorXd gradient;
  double nll = pairs_.evaluate(end.x, &gradient);
  const Eigen::VectorXd scale = scale_at(end.x);
  for (int iteration = 0; iteration < iterations && end.gradient_norm > close && std::isfinite(nll);
       ++iteration) {
    end.hessian = difference_hessian(pairs_, end.x, scale, near ? &gradient : nullptr);
    Eigen::MatrixXd B = inverse_curvature(end.hessian, scale);
    for (int iteration = 0; iteration < most; ++iteration, ++end.iterations) {
      Eigen::VectorXd step = -B * gradient;
      // No step longer than some standard deviations of what is expected.
      step *= std::min(1.0, 30.0 / step.cwiseQuotient(scale).cwiseAbs().maxCoeff());
      const double slope = gradient.dot(step);
      if (!(-slope > rounding * (1.0 + std::abs(nll)))) break;
      bool moved = false;
      for (double factor = 1.0; factor > 1e-6 && !moved; factor *= 0.4) {
        const Eigen::VectorXd trial = end.x + factor * step;
        Eigen::VectorXd at_trial;
        const double value = pairs_.evaluate(trial, &at_trial);
        if (!(value < nll + 1e-4 * factor * slope)) continue;
        moved = true;
        const Eigen::VectorXd s = trial - end.x, y = at_trial - gradient;
        if (const double sy = s.dot(y); sy > 1e-10 * s.norm() * y.norm()) {
          const Eigen::MatrixXd left = Eigen::MatrixXd::Identity(s.size(), s.size()) - s * y.transpose() / sy;
          B = left * B * left.transpose() + s * s.transpose() / sy;
        }
        end.x = trial;
        nll = value;
        gradient = std::move(at_trial);
        log.iteration(end.iterations + 1, nll, factor * std::sqrt(-slope), std::sqrt(-slope),
                      {"length", factor});
      }
      if (!moved) {
        log.iteration(end.iterations + 1, nll, 0.0, std::sqrt(-slope), {"length", 0.0});
        break;
      }
    }
    if (near && iteration == 0) {
      end.gradient_norm =
          std::sqrt(std::max(0.0, gradient.dot(inverse_curvature(end.hessian, scale) * gradient)));
      constexpr double close_enough = 1e-4;
      if (end.gradient_norm < close_enough) break;
    }
    end.hessian = difference_hessian(pairs_, end.x, scale);
    end.gradient_norm =
        std::sqrt(std::max(0.0, gradient.dot(inverse_curvature(end.hessian, scale) * gradient)));
  }
  log.end(end.iterations, nll, end.gradient_norm,
          end.gradient_norm < 1e-3 ? Outcome::converged : Outcome::not_converged);
  return end;
}

/// Of x and the shape, from the observed information; none where that is not positive definite.
void ShapeFit::add_covariance(const Eigen::MatrixXd& hessian, ShapeResult& best) const {
  // A shape parameter at its limit (nu at 1 or 200, p at 0) flattens its own direction: it is held there then.
  const int first = scaled_.unknowns();
  const NoiseShapeParameters reached = pairs_.shape_at(best.x);
  best.at_limit = at_limit(reached, pairs_.residuals(best.x).typical_spread());
  const Eigen::Index kept = best.at_limit ? first : best.x.size();
  const Eigen::MatrixXd part = hessian.topLeftCorner(kept, kept);
  if (Eigen::LLT<Eigen::MatrixXd>(part).info() != Eigen::Success) return;
  Eigen::MatrixXd inverse = part.inverse();
  if (!problem_.row_weight_square.empty()) {
    PairsProblem squared = problem_;
    squared.row_weight = squared.row_weight_square;
    const ShapePairs of_squares(squared, scaled_, law_, first_.shape, first_.outlier_mean < 0.0);
    const Eigen::MatrixXd J = difference_hessian(of_squares, best.x, scale_at(best.x));
    if (J.size() == 0) return;
    inverse = inverse * J.topLeftCorner(kept, kept) * inverse;
  }
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

/// The shape that goes with the residuals of least absolute deviations, or of the Gaussian optimum where there are none.
NoiseShapeParameters first_shape(const PairsProblem& problem, const ScaledPairs& scaled,
                                 const Vector& gaussian, NoiseLaw law, NoiseShape shape) {
  const Vector robust = least_absolute(problem, scaled, law, NoiseLaw::constant, gaussian);
  const Vector& x = robust.size() > 0 && robust.allFinite() ? robust : gaussian;
  NoiseShapeParameters first;
  first.shape = shape;
  if (shape == NoiseShape::student_t) return first;
  const ShapePairs plain(problem, scaled, law, NoiseShape::gaussian);
  const ResidualShape found = first_residual_shape(plain.residuals(x), shape);
  first.outlier_share = found.shape.outlier_share;
  first.outlier_mean = found.shape.outlier_mean;
  first.outlier_scale =
      std::clamp(found.shape.outlier_scale, NoiseShapeParameters::scale_min, NoiseShapeParameters::scale_max);
  return first;
}

}  // namespace

ShapeResult fit_shape(const PairsProblem& problem, const ScaledPairs& scaled, const Vector& gaussian,
                      NoiseLaw law, int noise_order, NoiseShape shape, const NestedFit* nested) {
  const ShapeFit fit(problem, scaled, law, noise_order, first_shape(problem, scaled, gaussian, law, shape));
  ShapeResult best;
  best.nll = std::numeric_limits<double>::infinity();
  // Where the starts have come to by expectation and maximisation, the likeliest first.
  std::vector<std::pair<double, Eigen::VectorXd>> from;
  for (const ShapeFit::Start& start : fit.starts(gaussian, nested)) {
    Eigen::VectorXd x = fit.reweighted(start);
    if (const double nll = fit.pairs().evaluate(x, nullptr); std::isfinite(nll))
      from.emplace_back(nll, std::move(x));
  }
  std::stable_sort(from.begin(), from.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  constexpr double hopeless = 10.0,
                   same = 1e-3;  // [nats]: behind the likeliest; ahead of where a descent ended
  for (auto& [nll_at_start, x] : from) {
    if (nll_at_start > from.front().first + hopeless) break;
    if (std::isfinite(best.nll) && std::abs(nll_at_start - from.front().first) < same) continue;
    const ShapeEnd end = fit.descend(std::move(x));
    const double nll = fit.pairs().evaluate(end.x, nullptr);
    if (nll < best.nll) fit.take(end, nll, best);
  }
  if (std::isfinite(best.nll)) {
    best.shape = fit.pairs().shape_at(best.x);
    best.weights = fit.pairs().weights(best.x);
  }
  return best;
}

ShapeResult fit_shape_from(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law,
                           int noise_order, const NestedFit& start) {
  const ShapeFit fit(problem, scaled, law, noise_order, start.shape);
  ShapeResult best;
  best.nll = std::numeric_limits<double>::infinity();
  const ShapeEnd end =
      fit.descend(fit.pairs().internal(scaled.from_user(start.alpha, start.noise), start.shape), true);
  const double nll = fit.pairs().evaluate(end.x, nullptr);
  if (!std::isfinite(nll)) return best;
  fit.take(end, nll, best);
  best.shape = fit.pairs().shape_at(best.x);
  best.weights = fit.pairs().weights(best.x);
  return best;
}

}  // namespace rangecal::pairs_ml
