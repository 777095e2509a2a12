// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "pairs_kernel.hpp"
#include "rangecal/core/noise.hpp"
#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"

namespace rangecal::pairs_ml {

inline constexpr int max_unknowns = 16;
/// Small vectors and matrices on the stack.
using Vector = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, max_unknowns, 1>;
using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, max_unknowns, max_unknowns>;

/// NLL and derivatives in x = (c_0 .. c_n, log sigma or beta in t).
struct Evaluation {
  double nll = 0.0;
  bool valid = false;
  Vector gradient;
  Matrix hessian, information;  ///< information only where asked for
};

/// The likelihood in the scaled distance t = (d - center) / half_width: f = sum c_k t^k.
class ScaledPairs {
 public:
  ScaledPairs(const PairsProblem& problem, int order, NoiseLaw law, int noise_order, int parallel_from);

  int unknowns() const { return order_ + 1 + noise_count_; }
  bool log_sigma() const { return has_sigma(law_); }  ///< the last unknown is log sigma
  int mean_unknowns() const { return order_ + 1; }
  void evaluate(const Vector& x, bool information, Evaluation& out) const;
  /// Least squares in one streaming pass, s as d^2; false where it cannot serve: take `seed` then.
  bool quick_seed(Vector& x) const;
  /// Weighted least squares with s as d^p, then sigma from its residuals (beta: a constant).
  Vector seed() const;

  Eigen::VectorXd alpha(const Vector& x) const;
  Noise noise(const Vector& x) const;
  /// d (alpha, noise parameters as sigma or beta) / d x.
  Matrix jacobian(const Vector& x) const;
  Vector from_user(const Eigen::VectorXd& alpha, const Noise& noise) const;
  /// True where the readings do not differ from f by more than rounding.
  bool perfect(const Vector& x) const;

 private:
  bool streams() const { return has_sigma(law_) && order_ <= kernel_max_order; }
  KernelSums sum(const PairsProblem& problem, const Vector& x, bool information, KernelLaw law) const;
  bool sampled() const { return !sample_.true_m.empty(); }
  Vector least_squares() const;
  Vector refine_on_sample(Vector x) const;
  void finish(const KernelSums& sums, const Vector& x, bool information, Evaluation& out) const;

  const PairsProblem& problem_;
  int order_, noise_count_;
  NoiseLaw law_;
  KernelLaw kernel_law_;
  double power_, center_, half_width_, typical_;
  double log_constant_;  ///< sum over cells of what the likelihood adds whatever x is
  PairsProblem scaled_;  ///< polynomial law only: the same cells over t
  PairsProblem sample_;  ///< of many cells every k-th, for the seed; else empty
  int parallel_from_;
  mutable std::vector<KernelSums> chunks_;
};

struct NewtonResult {
  Vector x;
  Evaluation at;               ///< with information
  double gradient_norm = 0.0;  ///< sqrt(g' I^-1 g) over the free unknowns
  int iterations = 0;
  Outcome outcome = Outcome::failed;
};

/// Damped Newton: exact second derivatives, expected information where these are not positive definite; steps are
/// cut until the NLL falls. `free`: how many leading unknowns move (all, or those of the mean alone).
NewtonResult minimise(const ScaledPairs& pairs, Vector x, int free, int max_iterations, double tolerance);

/// Coefficients of sum c_k ((d - center) / half_width)^k in powers of d: alpha = shift c.
Matrix shift_matrix(int order, double center, double half_width);

}  // namespace rangecal::pairs_ml
