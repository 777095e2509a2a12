// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/fleet/population.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/special_functions/beta.hpp>
#include <cmath>
#include <limits>
#include <optional>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/fleet/judgement.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// theta in units of its spread over the population: EM then sees numbers near one.
struct Scale {
  VectorXd origin, unit;
  UnitSummary in(const UnitSummary& u) const {
    return {(u.theta - origin).cwiseQuotient(unit), unit.asDiagonal() * u.information * unit.asDiagonal()};
  }
};

struct Pass {
  VectorXd first;
  MatrixXd second;  ///< of m_u, V_u and what is not known of mu
  MatrixXd weight;  ///< sum of (Sigma + Lambda_u^-1)^-1: what the units say of mu
  double log_likelihood = 0.0;
  std::int64_t kept = 0, left_out = 0;
};

/// E-step of one unit at (mu, Sigma): posterior mean and covariance of its theta, squared Mahalanobis distance of its estimate from mu, and its marginal log likelihood.
struct Step {
  VectorXd m;
  MatrixXd V;
  double distance_sq = 0.0, log_likelihood = 0.0;
};

Step step_of(const UnitSummary& u, const VectorXd& mu, const MatrixXd& precision, double log_det_Sigma) {
  const Eigen::Index p = mu.size();
  Step step;
  const Eigen::LLT<MatrixXd> sum(precision + u.information);
  step.V = sum.solve(MatrixXd::Identity(p, p));
  const VectorXd e = u.theta - mu, pull = u.information * e;
  const VectorXd moved = step.V * pull;
  step.m = mu + moved;
  // (Sigma + Lambda^-1)^-1 = Lambda - Lambda V Lambda = Sigma^-1 V Lambda, the last without cancellation
  step.distance_sq = std::fmax(0.0, e.dot(precision * moved));
  const double log_det_sum = 2.0 * sum.matrixLLT().diagonal().array().log().sum();
  const double log_det_information =
      2.0 * MatrixXd(u.information.llt().matrixL()).diagonal().array().log().sum();
  step.log_likelihood = -static_cast<double>(p) * half_log_two_pi -
                        0.5 * (step.distance_sq + log_det_Sigma + log_det_sum - log_det_information);
  return step;
}

Pass pass_over(const UnitStream& units, const Scale& scale, const VectorXd& mu, const MatrixXd& Sigma,
               const MatrixXd& V_mu, double limit, const std::vector<bool>& odd,
               std::vector<bool>& outlying) {
  const Eigen::Index p = mu.size();
  const Eigen::LLT<MatrixXd> factor(Sigma);
  const MatrixXd precision = factor.solve(MatrixXd::Identity(p, p));
  const double log_det = 2.0 * factor.matrixLLT().diagonal().array().log().sum();
  Pass pass{VectorXd::Zero(p), MatrixXd::Zero(p, p), MatrixXd::Zero(p, p)};
  std::size_t index = 0;
  units([&](const UnitSummary& raw) {
    const UnitSummary unit = scale.in(raw);
    const Step step = step_of(unit, mu, precision, log_det);
    const std::size_t at = index++;
    outlying[at] = odd[at] || step.distance_sq > limit;
    if (outlying[at]) {
      ++pass.left_out;
      return;
    }
    ++pass.kept;
    const VectorXd e = step.m - mu;
    pass.first += e;
    const MatrixXd K = step.V * unit.information;
    pass.second += step.V + K * V_mu * K.transpose() + e * e.transpose();
    pass.weight += precision * K;
    pass.log_likelihood += step.log_likelihood;
  });
  return pass;
}

/// The quantile `share` of every coordinate, from a histogram refined in five passes: outliers do not move the start of EM.
VectorXd quantiles_of_units(const UnitStream& units, const VectorXd& low, const VectorXd& high,
                            double share) {
  VectorXd a = low, b = high;
  const Eigen::Index p = a.size();
  for (int pass = 0; pass < 5; ++pass) {
    constexpr int bins = 64;
    Eigen::MatrixXd counts = Eigen::MatrixXd::Zero(p, bins);
    VectorXd below = VectorXd::Zero(p);
    double total = 0.0;
    units([&](const UnitSummary& u) {
      total += 1.0;
      for (Eigen::Index i = 0; i < p; ++i) {
        const double at = (u.theta[i] - a[i]) / (b[i] - a[i]) * bins;
        if (at < 0.0)
          below[i] += 1.0;
        else if (at < bins)
          counts(i, static_cast<Eigen::Index>(at)) += 1.0;
      }
    });
    for (Eigen::Index i = 0; i < p; ++i) {
      double sum = below[i];
      Eigen::Index bin = 0;
      while (bin + 1 < bins && sum + counts(i, bin) < share * total) sum += counts(i, bin++);
      const double width = (b[i] - a[i]) / bins;
      a[i] += width * static_cast<double>(bin);
      b[i] = a[i] + width;
    }
  }
  return 0.5 * (a + b);
}

/// Distance_sq of a unit left out that has the p-value q beside n others: (n - 1) (1 + 1/n) (1/x - 1), x ~
/// Beta((n - p) / 2, p / 2) by Hotelling's T^2; chi^2 with p degrees of freedom where n is large.
double distance_limit(double q, double n, double p) {
  if (!(q > 0.0) || n <= p) return std::numeric_limits<double>::infinity();
  return (n - 1.0 / n) * (1.0 / boost::math::ibeta_inv(0.5 * (n - p), 0.5 * p, q) - 1.0);
}

/// The stream, of which each pass has to bring as many units, of as many unknowns, as the first: a file may grow.
UnitStream same_each_time(const UnitStream& units, std::int64_t count, Eigen::Index unknowns) {
  return [&units, count, unknowns](const std::function<void(const UnitSummary&)>& visit) {
    std::int64_t seen = 0;
    const auto refuse = [&](const std::string& what) {
      throw InputError(fmt::format(
          "fit_population: the stream had {} units of {} unknowns at first, and in a later pass {}", count,
          unknowns, what));
    };
    units([&](const UnitSummary& unit) {
      if (seen++ == count) refuse("more units");
      if (unit.theta.size() != unknowns || unit.information.rows() != unknowns ||
          unit.information.cols() != unknowns)
        refuse(fmt::format("a unit of {}", unit.theta.size()));
      visit(unit);
    });
    if (seen != count) refuse(fmt::format("{} units", seen));
  };
}

/// Marks the units kept whose p-value is below `rate`; false where there is none, or too few would stay.
bool mark_odd(const UnitStream& units, const Population& population, double rate, std::vector<bool>& odd) {
  const FleetJudge judge(units, population);
  std::vector<bool> marked = odd;
  std::size_t index = 0;
  std::int64_t more = 0;
  units([&](const UnitSummary& unit) {
    const std::size_t at = index++;
    if (population.outlying[at] || !(judge(unit, at).p_value < rate)) return;
    marked[at] = true;
    ++more;
  });
  if (more == 0 || population.units - more < population.mean.size() + 2) return false;
  odd = std::move(marked);
  return true;
}

}  // namespace

void PopulationOptions::check() const {
  if (max_iterations < 1)
    throw InputError(fmt::format("PopulationOptions: max_iterations = {} is below 1", max_iterations));
  if (!(tolerance > 0.0))
    throw InputError(fmt::format("PopulationOptions: tolerance = {} is not positive", tolerance));
  if (!(outlier_rate >= 0.0 && outlier_rate < 1.0))
    throw InputError(fmt::format("PopulationOptions: outlier_rate = {} is not in [0, 1)", outlier_rate));
}

namespace {

Population population_of(const UnitStream& stream, const PopulationOptions& options, const SolverLog& log) {
  Population result;
  std::int64_t count = 0;
  VectorXd low, high;
  stream([&](const UnitSummary& u) {
    if (count == 0) low = high = u.theta;
    if (u.theta.size() != low.size() || u.information.rows() != low.size() ||
        u.information.cols() != low.size())
      throw InputError("fit_population: units differ in their number of unknowns");
    if (!u.theta.allFinite() || !u.information.allFinite())
      throw InputError("fit_population: a unit is not finite");
    if (u.information.llt().info() != Eigen::Success)
      throw InputError(
          "fit_population: a unit's information is not positive definite: it does not determine its own unknowns");
    low = low.cwiseMin(u.theta);
    high = high.cwiseMax(u.theta);
    ++count;
  });
  const Eigen::Index p = low.size();
  if (count < p + 2) {
    result.outcome = Outcome::too_few_data;
    result.reason = count == 0
                        ? "no unit has readings enough of its own"
                        : fmt::format("{} units are too few for a population of {} unknowns", count, p);
    return result;
  }
  const UnitStream units = same_each_time(stream, count, p);
  result.order = static_cast<int>(p) - 2;
  // Start: medians, and the middle two thirds as two standard deviations, widened.
  const VectorXd slack = 1e-9 * (high - low).cwiseAbs() + VectorXd::Constant(p, 1e-12);
  Scale scale;
  scale.origin = quantiles_of_units(units, low - slack, high + slack, 0.5);
  scale.unit = 0.5 * (quantiles_of_units(units, low - slack, high + slack, 0.8413) -
                      quantiles_of_units(units, low - slack, high + slack, 0.1587));
  scale.unit = scale.unit.cwiseMax(slack);
  VectorXd mu = VectorXd::Zero(p);
  MatrixXd Sigma = 4.0 * MatrixXd::Identity(p, p), V_mu = MatrixXd::Zero(p, p);
  const double rate = options.outlier_rate / static_cast<double>(count);
  const double limit = distance_limit(rate, static_cast<double>(count - 1), static_cast<double>(p));
  std::vector<bool> odd(static_cast<std::size_t>(count), false);
  result.outlying = odd;
  result.outcome = Outcome::not_converged;
  constexpr int enough = 4;  // passes in a row: what is not known of mu comes in a pass late
  int quiet = 0;
  double before = -std::numeric_limits<double>::infinity();
  std::int64_t kept_before = -1;
  const auto keep = [&] {
    result.mean = scale.origin + scale.unit.cwiseProduct(mu);
    result.covariance = scale.unit.asDiagonal() * Sigma * scale.unit.asDiagonal();
    result.mean_covariance = scale.unit.asDiagonal() * V_mu * scale.unit.asDiagonal();
  };
  for (result.iterations = 1; result.iterations <= options.max_iterations; ++result.iterations) {
    const Pass pass = pass_over(units, scale, mu, Sigma, V_mu, limit, odd, result.outlying);
    if (pass.kept < p + 2) {
      result.outcome = Outcome::failed;
      result.reason = "hardly any two units are alike";
      return result;
    }
    result.units = pass.kept;
    result.left_out = pass.left_out;
    result.log_likelihood =
        pass.log_likelihood - static_cast<double>(pass.kept) * scale.unit.array().log().sum();
    const Eigen::LLT<MatrixXd> weight(0.5 * (pass.weight + pass.weight.transpose()));
    V_mu = weight.solve(MatrixXd::Identity(p, p));
    // Restricted: that of mu known, times the volume of what is not known of mu.
    const double restricted = pass.log_likelihood - weight.matrixLLT().diagonal().array().log().sum();
    quiet = pass.kept == kept_before && restricted - before < options.tolerance ? quiet + 1 : 0;
    if (quiet == enough) {
      keep();
      if (!mark_odd(units, result, rate, odd)) {
        result.outcome = Outcome::converged;
        return result;
      }
      quiet = 0;
      continue;
    }
    log.iteration(result.iterations, -restricted, not_known, not_known);
    before = restricted;
    kept_before = pass.kept;
    const VectorXd shift = pass.first / static_cast<double>(pass.kept);
    mu += shift;
    Sigma = pass.second / static_cast<double>(pass.kept) - shift * shift.transpose();
  }
  result.reason = fmt::format("stopped after {} passes", options.max_iterations);
  keep();
  return result;
}

}  // namespace

Population fit_population(const UnitStream& stream, const PopulationOptions& options) {
  options.check();
  const SolverLog log("population");
  Population result = population_of(stream, options, log);
  log.end(result.iterations, -result.log_likelihood, not_known, result.outcome, result.reason);
  return result;
}

MatrixXd Population::spread() const {
  if (mean_covariance.size() == 0) return covariance;
  const double N = static_cast<double>(units), p = static_cast<double>(mean.size());
  const double widening = (N - 1.0) / std::max(0.5, N - p - 2.0);
  return covariance + (widening - 1.0) * N * mean_covariance;
}

UnitPosterior shrink(const UnitSummary& unit, const Population& population) {
  const Eigen::Index p = population.mean.size();
  if (unit.theta.size() != p)
    throw InputError(fmt::format("shrink: {} unknowns where the population has {}", unit.theta.size(), p));
  const Scale scale{population.mean, population.covariance.diagonal().cwiseSqrt()};
  const VectorXd inverse = scale.unit.cwiseInverse();
  const std::optional<MatrixXd> precision =
      scaled_inverse(inverse.asDiagonal() * population.spread() * inverse.asDiagonal());
  if (!precision) throw InputError("shrink: the population's covariance is not positive definite");
  const UnitSummary scaled = scale.in(unit);
  const Step step = step_of(scaled, VectorXd::Zero(p), *precision, 0.0);
  UnitPosterior result;
  result.mean = scale.origin + scale.unit.cwiseProduct(step.m);
  MatrixXd V = step.V;
  if (population.mean_covariance.size() > 0) {
    const MatrixXd pull =
        MatrixXd::Identity(p, p) - step.V * scaled.information;  // of the population's mean on the answer
    V += pull * inverse.asDiagonal() * population.mean_covariance * inverse.asDiagonal() * pull.transpose();
  }
  result.covariance = scale.unit.asDiagonal() * V * scale.unit.asDiagonal();
  return result;
}

}  // namespace rangecal
