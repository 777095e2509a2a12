// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"

namespace rangecal {

/// Sensors of one make differ (Alhashimi 2016, section 6). Each has theta = (alpha_0 .. alpha_n, log sigma),
/// alpha_i in m^(1-i), sigma that of a noise law with one parameter, and
///
///   theta_u ~ N(mu, Sigma),            readings_u | theta_u: the likelihood of the 2016 problem,
///
/// which for a unit with readings enough is N(theta; theta^_u, Lambda_u^-1), theta^_u its maximum without the
/// bias of sigma, Lambda_u the expected information there (`summarise`). Sigma maximises the restricted
/// likelihood, that of prod_u N(theta^_u; mu, Sigma + Lambda_u^-1) with mu integrated out, by EM:
///
///   V_u = (Sigma^-1 + Lambda_u)^-1,  K_u = V_u Lambda_u,  m_u = mu + K_u (theta^_u - mu),
///   V_mu = (sum_u (Sigma + Lambda_u^-1)^-1)^-1,
///   mu = mean m_u,  Sigma = mean (V_u + K_u V_mu K_u^T + (m_u - mu) (m_u - mu)^T)
///
/// (Laird and Ware 1982, Biometrics 38, 963; Gelman et al., Bayesian Data Analysis, ch. 5). m_u is the unit's
/// posterior: its own answer, shrunk towards the population; its covariance is V_u + (1 - K_u) V_mu (1 -
/// K_u)^T, since mu is an estimate.
struct UnitSummary {
  Eigen::VectorXd theta;        ///< theta^_u
  Eigen::MatrixXd information;  ///< Lambda_u
};

struct Population {
  Outcome outcome = Outcome::failed;  ///< converged; too_few_data; not_converged
  std::string reason;
  int order = 2;
  NoiseLaw law = NoiseLaw::f_squared;
  NoiseShapeParameters shape;                   ///< what outliers its units have
  double range_min_m = 0.0, range_max_m = 0.0;  ///< distances that the units were seen at
  Eigen::VectorXd mean;                         ///< mu
  Eigen::MatrixXd covariance;                   ///< Sigma
  Eigen::MatrixXd mean_covariance;              ///< V_mu; empty: mu is exact
  double log_likelihood = 0.0;                  ///< marginal [nats], of the units kept
  int iterations = 0;
  std::int64_t units = 0, left_out = 0;  ///< kept; outlying, of no influence on mu and Sigma
  std::vector<bool> outlying;            ///< which ones, in the order of the stream; files do not keep them

  /// Sigma as posteriors use it. The inverse of T = Sigma + Lambda^-1, as N units estimate it, is too large
  /// by w = (N - 1) / (N - p - 2) on average, p = size(mu), which would draw the units of a small fleet too
  /// close (Efron and Morris 1976, Annals of Statistics 4, 22): Sigma + (w - 1) N V_mu, where N V_mu is T's
  /// mean.
  Eigen::MatrixXd spread() const;
};

/// Calls its argument once for every unit, each time in the same order: a file, a table, an array.
using UnitStream = std::function<void(const std::function<void(const UnitSummary&)>&)>;

struct PopulationOptions {
  int max_iterations = 3000;  ///< passes over the units
  double tolerance =
      1e-3;  ///< on the gain of log likelihood in a pass [nats]; a scatter of 0 is reached slowly
  /// Units whose p-value beside the rest (FleetJudge) is below this over their number are left out, until
  /// none is or too few would stay.
  double outlier_rate = 0.01;

  void check() const;
};

/// Memory: two bits for each unit; the same bits whatever made the stream. too_few_data: fewer units than
/// unknowns of theta + 2. Throws InputError for units that differ in their unknowns or are not finite, and a stream
/// that has another number of units in a later pass. Cost: some 2 us per unit and pass, 20 to 500 passes.
Population fit_population(const UnitStream& units, const PopulationOptions& options = {});

/// A unit before the background of its population.
struct UnitPosterior {
  Eigen::VectorXd mean;        ///< m_u
  Eigen::MatrixXd covariance;  ///< V_u + (1 - K_u) V_mu (1 - K_u)^T
};
/// Throws InputError where unit and population differ in their unknowns, or Sigma is not positive definite.
UnitPosterior shrink(const UnitSummary& unit, const Population& population);

/// theta and information of a calibration with p coefficients of f. By `full` from N readings, N sigma^^2 /
/// sigma^2 is chi^2 with N - p degrees of freedom (exact where the weights 1 / s^2 are known; psi digamma,
/// psi' trigamma):
///
///   E log sigma^ - log sigma = (psi((N - p) / 2) - log(N / 2)) / 2,
///   var log sigma^ = psi'((N_e - p) / 2) / 4,
///   cov alpha^ = N / (N - p) times that at sigma^,
///
/// N_e = 1 / (2 var) by the expected information: N where alpha says nothing of s. The bias is taken off
/// theta. Over units of 40 readings and order 2, sigma^ itself would put mu of log sigma at -0.053. sigma by
/// `marginal` counts the coefficients already, and so do those of `closed_form` and `approximate`, which
/// divide by N - p: there p = 0 and N = N_e. Of another noise shape than the Gaussian N = N_e. `approximate` with the law d^2 has the sigma of the 2016 paper's
/// eq. 26, divided by N, and deviations by N - p: the bias is that of `full` with N = N_e + p. Nothing where
/// it has no covariance, more than one noise parameter, or no more readings than coefficients.
std::optional<UnitSummary> summarise(const Calibration& calibration);

/// The calibration of a unit from its pairs and its population together: the maximum of likelihood times
/// N(theta; mu, Sigma + V_mu), covariance the inverse of the information there, the prior's included. A
/// handful of readings will do, none gives the population. Readings have the population's noise shape: by expectation and
/// maximisation from mu, where an error counts in the spread of the reading and of the population's curve. Throws InputError for a population without an
/// answer, or with a Sigma that is not positive definite. Outcomes: converged, not_converged, failed. Cost: 10
/// passes over the readings.
Calibration calibrate_in_population(const PairsProblem& problem, const Population& population);

/// What a unit's residuals z = (y - f) / s show that its curve does not hold, for readings in their order;
/// p-values of each alone, two-sided, 1 where there are too few readings: below 30 for the tails, below 100
/// for the others.
struct UnitMisfit {
  /// k = two orders more, up to 8, fit better: likelihood ratio l of p coefficients, exp(-l / N) is
  /// Beta((N - p) / 2, k / 2).
  double shape_p = 1.0;
  /// Kurtosis of z, by its law for N - p independent values: far from normal for any N of a sensor.
  double tail_p = 1.0;
  double dependence_p = 1.0;  ///< correlation r of neighbours: r sqrt(N) is N(0, 1)
  double shape_m = 0.0;       ///< largest change of f by the two orders [m]
  double kurtosis = 0.0, correlation = 0.0;
};
UnitMisfit unit_misfit(const Recording& recording, const Calibration& calibration);

/// `rangecal-population/1` JSON, and back; throws InputError naming `name` for a text that is none.
std::string population_to_json(const Population& population);
Population population_from_json(const std::string& text, const std::string& name);

}  // namespace rangecal
