// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "pairs_newton.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "robust/residual_shape.hpp"

namespace rangecal::pairs_ml {

/// The row likelihood sum_i [ log s_i - log g(z_i) ], z_i = (y_i - f(d_i)) / s_i, g the shape's density, with its
/// gradient in (x, shape) where the shape's parameters go by log(nu - 1), logit(2 p),
/// logit(log(k / 3) / log(1000 / 3)) and log |outlier_mean|.
class ShapePairs {
 public:
  /// `early`: outliers of the one-sided shape lie below the curve.
  ShapePairs(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law, NoiseShape shape,
             bool early = false)
      : problem_(problem), scaled_(scaled), law_(law), shape_(shape), sign_(early ? -1.0 : 1.0) {}

  int unknowns() const { return scaled_.unknowns() + shape_parameter_count(shape_); }
  /// Infinity, with no gradient, outside of the domain.
  double evaluate(const Eigen::VectorXd& x, Eigen::VectorXd* gradient) const;
  NoiseShapeParameters shape_at(const Eigen::VectorXd& x) const;
  Eigen::VectorXd internal(const Vector& x, const NoiseShapeParameters& shape) const;
  /// Robust weights of the rows at x; of the one-sided shape the probabilities of no outlier.
  std::vector<double> weights(const Eigen::VectorXd& x) const;
  /// Errors of the rows in their spreads at x (the shape's own coordinates, if there are any, are not read).
  ChannelResiduals residuals(const Eigen::VectorXd& x) const;

 private:
  const PairsProblem& problem_;
  const ScaledPairs& scaled_;
  NoiseLaw law_;
  NoiseShape shape_;
  double sign_;
};

/// Standard deviations of nu, of p and k, or of p and outlier_mean, from the variances of what the solver moves (ShapePairs); none for none.
std::vector<double> deviations_of(const NoiseShapeParameters& shape, const Eigen::VectorXd& variances);

struct ShapeResult {
  Eigen::VectorXd x;  ///< (x, shape), internal
  NoiseShapeParameters shape;
  double nll = 0.0, gradient_norm = 0.0;
  /// Of x without the shape, from the observed information H; with rows of weights w H^-1 J H^-1, H = sum w i and
  /// J = sum w^2 i. Empty if singular.
  Eigen::MatrixXd covariance;
  std::vector<double>
      shape_std;  ///< of the shape's parameters; empty where there is no covariance, or at a limit
  std::vector<double> weights;
  bool at_limit = false;  ///< a shape parameter ran to its limit and is held there in the covariance
  int iterations = 0;
  Outcome outcome = Outcome::failed;
};

/// A fit of lower order, as one more start: the likelihood can then not fall with the order.
struct NestedFit {
  Eigen::VectorXd alpha;
  Noise noise;
  NoiseShapeParameters shape;
};

/// Minimises it: expectation-maximisation with the streaming Gaussian solver as its maximisation, from the Gaussian
/// optimum, from least absolute deviations and from `nested` (may be null); then BFGS from the
/// observed information.
ShapeResult fit_shape(const PairsProblem& problem, const ScaledPairs& scaled, const Vector& gaussian,
                      NoiseLaw law, int noise_order, NoiseShape shape, const NestedFit* nested);

/// From where the fit of nearly the same readings ended, of the same order and shape: BFGS alone.
ShapeResult fit_shape_from(const PairsProblem& problem, const ScaledPairs& scaled, NoiseLaw law,
                           int noise_order, const NestedFit& start);

}  // namespace rangecal::pairs_ml
