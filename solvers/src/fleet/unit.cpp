// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/special_functions/beta.hpp>
#include <boost/math/special_functions/digamma.hpp>
#include <boost/math/special_functions/trigamma.hpp>
#include <cmath>
#include <vector>

#include "fleet/posterior_in_population.hpp"
#include "json_states.hpp"
#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/fleet/population.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "statistics/kurtosis_law.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int highest_order = 8;  // of f in the test of its shape

constexpr std::size_t fewest_for_tails = 30, fewest_for_all = 100;  // readings

/// P of a larger likelihood ratio 2 (nll - wider nll), by `more` coefficients that N readings with
/// `coefficients` in all do not need: sigma^2 of the wider fit over that of the other is Beta((N -
/// coefficients) / 2, more / 2).
double likelihood_ratio_upper(double ratio, double N, int coefficients, int more) {
  if (!(ratio > 0.0) || N <= coefficients) return 1.0;
  return boost::math::ibeta(0.5 * (N - coefficients), 0.5 * more, std::exp(-ratio / N));
}

/// Robust weights of the readings at theta = x by the population's shape, an error counting in the spread of the reading and
/// that of a curve of covariance `curve`.
std::vector<double> weights_at(const PairsProblem& problem, const VectorXd& x, const MatrixXd& curve,
                               const Population& population) {
  const Eigen::Index n = x.size() - 1;
  const Noise noise{population.law, VectorXd::Constant(1, std::exp(x[n]))};
  const ShapeDensity density_at(population.shape);
  std::vector<double> weights;
  for (std::size_t i = 0; i < problem.row_true_m.size(); ++i) {
    const double d = problem.row_true_m[i], f = evaluate_polynomial(x.head(n), d), s = noise.spread(d, f);
    const VectorXd powers = powers_of(d, n);
    const double spread = std::sqrt(s * s + powers.dot(curve * powers));
    weights.push_back(1.0 - density_at((problem.row_reading_m[i] - f) / spread, spread).outlier);
  }
  return weights;
}

}  // namespace

std::optional<UnitSummary> summarise(const Calibration& calibration) {
  if (calibration.outcome != Outcome::converged || !calibration.alpha_covariance ||
      calibration.noise.parameters.size() != 1 || calibration.noise_estimates.size() != 1 ||
      !calibration.noise_estimates[0].std_dev || !(calibration.noise.parameters[0] > 0.0))
    return std::nullopt;
  const Eigen::Index n = calibration.alpha.size();
  UnitSummary unit{VectorXd(n + 1), MatrixXd::Zero(n + 1, n + 1)};
  const double sigma = calibration.noise.parameters[0];
  const double worth = 0.5 * std::pow(sigma / *calibration.noise_estimates[0].std_dev, 2);  // N_e
  // Only `full` divides by N throughout; the closed forms divide by N - p as `marginal` does, but for eq. 26
  // of the 2016 paper.
  const bool full = calibration.method == Method::full;
  const bool printed =
      calibration.method == Method::approximate && calibration.noise.law == NoiseLaw::d_squared;
  const double p = static_cast<double>(n), lost = full ? p : 0.0;
  const double readings = full && calibration.counts.used > 0 && calibration.noise_shapes.empty()
                              ? calibration.counts.used
                              : worth;
  if (!(worth > lost) || !(readings > lost)) return std::nullopt;
  const double divisor = printed ? readings + p : readings;
  const double bias = 0.5 * (boost::math::digamma(0.5 * (readings - lost)) - std::log(0.5 * divisor));
  unit.theta << calibration.alpha, std::log(sigma) - bias;
  const Eigen::LLT<MatrixXd> factor(*calibration.alpha_covariance);
  if (factor.info() != Eigen::Success) return std::nullopt;
  unit.information.topLeftCorner(n, n) = (1.0 - lost / readings) * factor.solve(MatrixXd::Identity(n, n));
  unit.information(n, n) = 4.0 / boost::math::trigamma(0.5 * (worth - lost));
  if (!unit.information.allFinite() || unit.information.llt().info() != Eigen::Success) return std::nullopt;
  return unit;
}

Calibration calibrate_in_population(const PairsProblem& problem, const Population& population) {
  const Eigen::Index p = population.mean.size(), n = p - 1;
  if (!is_usable(population.outcome) || p < 2)
    throw InputError("calibrate_in_population: the population has no answer");
  MatrixXd prior = population.spread();
  if (population.mean_covariance.size() > 0) prior += population.mean_covariance;
  const std::optional<MatrixXd> precision = scaled_inverse(prior);
  if (!precision)
    throw InputError("calibrate_in_population: the population's covariance is not positive definite");
  Calibration result;
  result.method = Method::full;
  result.kind = RecordingKind::pairs;
  result.counts = problem.counts;
  result.range_min_m = population.range_min_m;
  result.range_max_m = population.range_max_m;
  const auto minimum = [&](const PairsProblem& readings, const VectorXd& start) {
    const PosteriorInPopulation posterior(readings, population, *precision);
    return pairs_ml::minimise([&](const VectorXd& x) { return posterior.derivatives(x); }, start);
  };
  PairsProblem readings = problem;
  pairs_ml::DenseNewton joint;
  joint.x = population.mean;
  constexpr int iterations = 8;
  const bool outliers = population.shape.shape != NoiseShape::gaussian;
  for (int iteration = 0; iteration < (outliers ? iterations : 0) && joint.outcome != Outcome::failed;
       ++iteration) {
    const MatrixXd curve = iteration == 0 ? MatrixXd(prior.topLeftCorner(n, n)) : MatrixXd::Zero(n, n);
    readings = pairs_as_rows(problem, weights_at(problem, joint.x, curve, population));
    joint = minimum(readings, joint.x);
  }
  if (!outliers) joint = minimum(readings, population.mean);
  const PosteriorInPopulation posterior(readings, population, *precision);
  result.outcome = joint.outcome;
  result.iterations = joint.iterations;
  const auto take = [&](const VectorXd& x) {
    result.alpha = x.head(n);
    result.noise = {population.law, VectorXd::Constant(1, std::exp(x[n]))};
  };
  take(joint.x);
  if (result.outcome != Outcome::converged) {
    result.reason = joint.outcome == Outcome::failed
                        ? "the population's mean lies outside the model's domain at these distances"
                        : "the Newton steps did not settle";
    return result;
  }
  const std::optional<PosteriorInPopulation::Marginal> marginal = posterior.marginal(joint.x);
  if (!marginal) {
    result.outcome = Outcome::failed;
    result.reason = "the information at the end is not positive definite";
    return result;
  }
  take(marginal->x);
  result.alpha_covariance = marginal->covariance.topLeftCorner(n, n);
  result.covariance_reason = "of the posterior, population included";
  const double sigma = result.noise.parameters[0];
  result.noise_estimates = {Estimate{sigma, sigma * std::sqrt(marginal->covariance(n, n))}};
  result.joint_nll = result.marginal_nll = pairs_nll(problem, result.alpha, result.noise);
  return result;
}

UnitMisfit unit_misfit(const Recording& recording, const Calibration& calibration) {
  UnitMisfit misfit;
  const Pairs& pairs = recording.pairs;
  const std::size_t count = pairs.size();
  if (recording.kind != RecordingKind::pairs || count < fewest_for_tails ||
      calibration.outcome != Outcome::converged)
    return misfit;
  double second = 0.0, fourth = 0.0, scores = 0.0, neighbours = 0.0, before = 0.0;
  const ShapeDensity density_at(noise_shape_of(calibration, "range"));
  for (std::size_t i = 0; i < count; ++i) {
    const double f = evaluate_polynomial(calibration.alpha, pairs.true_m[i]);
    const double s = calibration.noise.spread(pairs.true_m[i], f), z = (pairs.reading_m[i] - f) / s;
    second += z * z;
    fourth += z * z * z * z;
    const double score = -density_at(z, s).derivative;  // of outliers nothing depends
    scores += score * score;
    neighbours += score * before;
    before = score;
  }
  const double N = static_cast<double>(count);
  misfit.kurtosis = N * fourth / (second * second) - 3.0;
  misfit.correlation = neighbours / scores;
  const double degrees = N - static_cast<double>(calibration.alpha.size());
  misfit.tail_p = normal_two_sided(kurtosis_score(misfit.kurtosis + 3.0, degrees));
  if (count < fewest_for_all) return misfit;
  misfit.dependence_p = normal_two_sided(misfit.correlation * std::sqrt(N));
  const int more = std::min(2, highest_order - calibration.order());
  if (more < 1) return misfit;
  PairsOptions wider;
  wider.order = calibration.order() + more;
  wider.law = calibration.noise.law;
  wider.shape = noise_shape_of(calibration, "range").shape;
  const PairsFit fit = full_pairs(make_pairs_problem({&recording, 1}), wider);
  if (fit.calibration.outcome != Outcome::converged || !calibration.joint_nll) return misfit;
  const double gain = 2.0 * (*calibration.joint_nll - fit.nll);
  misfit.shape_p = likelihood_ratio_upper(gain, N, *wider.order + 1, more);
  for (int i = 0; i <= 20; ++i) {
    const double d = calibration.range_min_m + i / 20.0 * (calibration.range_max_m - calibration.range_min_m);
    misfit.shape_m = std::max(misfit.shape_m, std::abs(evaluate_polynomial(fit.calibration.alpha, d) -
                                                       evaluate_polynomial(calibration.alpha, d)));
  }
  return misfit;
}

static void fields(JsonFields& json, Population& population) {
  json.format({"rangecal-population/1"});
  json.word("outcome", population.outcome, outcome_from_string);
  json.required("reason", population.reason);
  json.whole("order", population.order);
  json.word("law", population.law, noise_law_from_string);
  json.required("range_m", std::tie(population.range_min_m, population.range_max_m));
  json.optional("noise_shape", population.shape);  // files of earlier versions know Gaussian noise alone
  json.whole("units", population.units);
  json.whole("left_out", population.left_out);
  json.required("log_likelihood", population.log_likelihood);
  json.whole("iterations", population.iterations);
  json.numbers("mean", population.mean);
  json.square("covariance", population.covariance, population.mean.size());
  if (json.has("mean_covariance") || population.mean_covariance.size() > 0)
    json.square("mean_covariance", population.mean_covariance, population.mean.size());
  json.check(population.covariance.allFinite(), "covariance", "is not finite");
  json.check(population.mean_covariance.allFinite(), "mean_covariance", "is not finite");
}

std::string population_to_json(const Population& population) { return json_of(population).dump(2) + "\n"; }

Population population_from_json(const std::string& text, const std::string& name) {
  Population population;
  read_json(text, name, population);
  return population;
}

}  // namespace rangecal
