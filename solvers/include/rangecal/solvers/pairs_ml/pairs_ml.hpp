// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"

namespace rangecal {

struct PairsOptions {
  std::optional<int> order = 2;  ///< of f; nullopt: 1 .. max_order, the lowest AIC
  int max_order = 4;             ///< of the search by AIC
  NoiseLaw law = NoiseLaw::f_squared;
  int noise_order = 1;  ///< of the noise polynomial, law `polynomial` only
  NoiseShape shape = NoiseShape::gaussian;
  int max_iterations = 100;
  double gradient_tolerance = 1e-8;  ///< on the gradient norm in Fisher-scaled units, sqrt(g' I^-1 g)
  int parallel_from = 65536;         ///< cells from which on the passes run on several threads

  /// Throws InputError naming the bad field and its value.
  void check() const;
};

/// One order of f in the search for the best. AIC = 2 (nll + k), AICc = AIC + 2 k (k+1) / (N - k - 1),
/// BIC = 2 nll + k log N, k the parameters of f, noise and shape.
struct OrderScore {
  int order = 0;
  double nll = 0.0, aic = 0.0, aicc = 0.0, bic = 0.0;
  Outcome outcome = Outcome::failed;
};

struct PairsFit {
  Calibration calibration;         ///< covariances from the expected information at the estimate
  NoiseShapeParameters shape;      ///< for shapes other than the Gaussian, noise holds the scale
  std::vector<double> shape_std;   ///< of its parameters, in their order; empty where there are none
  double nll = 0.0;                ///< plain NLL at the estimate [nats], of the shape delivered
  double gradient_norm = 0.0;      ///< sqrt(g' I^-1 g) at the estimate of `full`, dimensionless
  std::vector<OrderScore> orders;  ///< one per order tried, ascending, of the shape delivered
  std::vector<std::pair<NoiseShape, double>> shapes;  ///< AIC of every shape tried, at its best order
};

/// Exact maximum likelihood of the 2016 problem (Alhashimi 2016, eq. 17-20): alpha and noise together minimise
/// pairs_nll with its log-determinant. Damped Newton steps on the exact second derivatives, the expected information
/// where these are not positive definite, in the scaled distance t = (d - center) / half width, from weighted least
/// squares; the step is invariant to the basis of f. The same bits for any number of threads.
///
/// Outcomes: `converged`; `too_few_data`: fewer readings than unknowns; `unobservable`: fewer distinct distances than
/// coefficients, then f is delivered at the highest order that they determine, without covariance, and the direction
/// left open is named; `unbounded`: every residual is zero; `not_converged`; `failed`.
/// Cost: one pass of about 0.6 ns per cell and iteration, 4 to 6 iterations.
PairsFit full_pairs(const PairsProblem& problem, const PairsOptions& options = {});

/// The answer of full_pairs for readings that are nearly those of `start`, a fit that converged, and its order, law and
/// shape: Newton's or BFGS steps from there alone. `options` says the rest.
PairsFit full_pairs_from(const PairsProblem& problem, const PairsFit& start,
                         const PairsOptions& options = {});

/// The noise shape of lowest AIC at the residuals of a curve of least absolute deviations, of the order and noise law of
/// `options`; Gaussian unless another gains `margin` in AIC, or where no curve goes through. Cost: some 100 passes.
NoiseShape shape_of_pairs(const PairsProblem& problem, const PairsOptions& options, double margin = 4.0);

/// The same alpha criterion with the noise by REML (flat prior on alpha):
///
///   noise = argmin  [ min_alpha NLL(alpha, noise) ] + 1/2 log det d^2 NLL / d alpha^2,   alpha = its minimiser.
///
/// nll is the plain NLL there. The order is chosen by the AIC of `full`, since REML values of different means do not
/// compare. Shapes other than the Gaussian use the same correction with the expected information of the Gaussian of
/// their weights.
PairsFit marginal_pairs(const PairsProblem& problem, const PairsOptions& options = {});

}  // namespace rangecal
