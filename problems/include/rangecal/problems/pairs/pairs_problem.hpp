// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "rangecal/core/noise.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// The 2016 problem (Alhashimi 2016, eq. 17-20): readings y at known true distances d, both in metres,
///
///   y ~ N(f(d), s(d)^2),   f(d) = sum_i alpha_i d^i,   s a NoiseLaw.
///
/// Readings of one true distance share mean and variance, so count, mean and mean square deviation say all that
/// the Gaussian likelihood can know. Structure of arrays, ascending in distance.
struct PairsProblem {
  std::vector<double> true_m;       ///< d of the cell [m], all different
  std::vector<double> count;        ///< R, the number of readings: the weight of log s
  std::vector<double> weight;       ///< weight of the squares: R, or the sum of robust weights
  std::vector<double> mean_m;       ///< weighted mean of y [m]
  std::vector<double> mean_square;  ///< weighted mean square deviation about mean_m [m^2]
  bool single = true;               ///< every cell is one reading of weight one

  std::vector<double> row_true_m;  ///< the readings themselves, ascending in distance: what a likelihood that
  std::vector<double> row_reading_m;      ///< is not Gaussian needs
  std::vector<double> row_weight;         ///< readings that a row stands for, sum w; empty: one each
  std::vector<double> row_weight_square;  ///< sum w^2, where these are not all 1; empty: as row_weight
  Counts counts;                          ///< summed over the recordings

  std::size_t size() const { return true_m.size(); }  ///< cells
  double weight_of_row(std::size_t i) const { return row_weight.empty() ? 1.0 : row_weight[i]; }
  double readings() const;
};

/// Groups the readings of all recordings (kind pairs, one sensor) by true distance. Throws InputError for a
/// recording of another kind. Cost: sorting the readings.
PairsProblem make_pairs_problem(std::span<const Recording> recordings);

/// The same from plain arrays [m]. Throws InputError for different lengths and values that are not finite.
PairsProblem make_pairs_problem(std::span<const double> true_m, std::span<const double> reading_m);

/// The same of rows that stand for many readings each, as sums over them have it: sum w > 0 and, unless every w is 1,
/// sum w^2. Every row is a cell.
PairsProblem make_weighted_pairs(std::span<const double> true_m, std::span<const double> reading_m,
                                 std::span<const double> weight, std::span<const double> weight_square = {});

/// Cells of one row each, with given robust weights of the squares (one per row; empty: all one). For tests and for
/// likelihoods with robust weights.
PairsProblem pairs_as_rows(const PairsProblem& problem, std::span<const double> weights = {});

/// Negative log-likelihood [nats], constants included, over cells of R readings with weight w (w = R without
/// robust weights):
///
///   sum_cells [ R (log s + log(2 pi) / 2) + w ((mean - f)^2 + mean_square) / (2 s^2) ]
///
/// +infinity where a spread is not positive. Cost: linear in the cells.
double pairs_nll(const PairsProblem& problem, const Eigen::VectorXd& alpha, const Noise& noise);

/// pairs_nll with its derivatives in theta = (alpha_0 .. alpha_n, noise), where noise is log sigma for the power
/// laws and d_squared, and beta_0 .. beta_m for the polynomial law.
struct PairsDerivatives {
  double nll = 0.0;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;      ///< observed information: second derivatives of nll
  Eigen::MatrixXd information;  ///< expected information: sum R (f_j f_k + 2 s_j s_k) / s^2
};
PairsDerivatives pairs_derivatives(const PairsProblem& problem, const Eigen::VectorXd& alpha,
                                   const Noise& noise);

}  // namespace rangecal
