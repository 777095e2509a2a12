// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/range_model.hpp"

#include <algorithm>
#include <cmath>

#include "closed_form/moments.hpp"
#include "closed_form/residual_spread.hpp"
#include "rangecal/core/distributions.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// sqrt(mean square of R normal deviates) has mean c(R) sigma: c(1) = sqrt(2 / pi), c -> 1.
double mean_root_square(double R) {
  return std::sqrt(2.0 / R) * std::exp(log_gamma(0.5 * (R + 1.0)) - log_gamma(0.5 * R));
}

/// Variance of the distance of a sample, by stop and landmark [m^2].
double distance_variance(const RangeSample& s, const std::vector<Eigen::Matrix2d>& landmark_covariance) {
  if (landmark_covariance.empty()) return s.d_variance;
  return s.d_variance + s.u.dot(landmark_covariance[s.landmark] * s.u);
}

/// The shape of the noise at a sample: s = sigma * shape for the power laws, the polynomial itself otherwise.
Noise unit_noise(NoiseLaw law) {
  Noise noise;
  noise.law = law;
  noise.parameters = VectorXd::Ones(1);
  return noise;
}

/// beta of s = sum beta_i d^i by regression, its degree lowered until s > 0 over the data.
struct BetaFit {
  VectorXd beta;
  MatrixXd covariance;
};
BetaFit fit_beta(const std::vector<RangeSample>& samples, const VectorXd& alpha) {
  std::vector<double> d, spread, weights;
  for (const RangeSample& s : samples) {
    const double r = s.y - evaluate_polynomial(alpha, s.d);
    d.push_back(s.d);
    spread.push_back(std::sqrt(s.mean_square + r * r) / mean_root_square(s.R));
    weights.push_back(s.R);
  }
  const auto [low, high] = std::minmax_element(d.begin(), d.end());
  for (int degree = static_cast<int>(alpha.size()) - 1; degree >= 0; --degree) {
    std::vector<double> w(weights);
    PolynomialFit fit;
    bool positive = false;
    for (int pass = 0; pass < 3; ++pass) {
      fit = fit_polynomial(d, spread, degree, w);
      positive = fit.usable();
      for (int i = 0; i <= 100 && positive; ++i)
        positive = evaluate_polynomial(fit.alpha, *low + (*high - *low) * i / 100.0) > 0.0;
      if (!positive) break;
      for (std::size_t k = 0; k < w.size(); ++k)
        w[k] = weights[k] / std::pow(evaluate_polynomial(fit.alpha, d[k]), 2);
    }
    if (positive) return {fit.alpha, fit.sigma_sq * fit.cofactor};
  }
  return {VectorXd::Zero(1), MatrixXd::Zero(1, 1)};  // all residuals are 0
}

void fit_noise(const std::vector<RangeSample>& samples,
               const std::vector<Eigen::Matrix2d>& landmark_covariance, const MatrixXd& gain, NoiseLaw law,
               RangeModel& model) {
  BetaFit beta;
  Noise shape = unit_noise(law);
  if (!has_sigma(law)) {
    beta = fit_beta(samples, model.alpha);
    shape.parameters = beta.beta;
  }
  double widest = 0.0;
  for (const RangeSample& s : samples)
    widest = std::max(widest, shape.spread(s.d, evaluate_polynomial(model.alpha, s.d)));
  std::vector<MomentTerm> terms;
  terms.reserve(samples.size());
  double within = 0.0, bare = 0.0, dof_within = 0.0, dof = -static_cast<double>(model.alpha.size());
  for (const RangeSample& s : samples) {
    const double f = evaluate_polynomial(model.alpha, s.d), slope = evaluate_derivative(model.alpha, s.d);
    const double g = std::max(shape.spread(s.d, f), 1e-12 * widest), r = s.y - f;
    terms.push_back({r * r, g * g / s.R, slope * slope * distance_variance(s, landmark_covariance)});
    bare += r * r / (g * g / s.R);
    if (!(f > 0.0)) model.f_positive = false;
    within += s.R * s.mean_square / (g * g);
    dof_within += s.R - 1.0;
    dof += s.R;
  }
  if (!model.f_positive) model.note = "f is not positive at every distance of the data";
  double variance = variance_from_moments(terms, within, dof);
  // As if stops and landmarks were exact.
  const double whole = dof > 0.0 && std::isfinite(within + bare) ? (within + bare) / dof : 0.0;
  // Below a ten-thousandth of the residuals nothing is left that the stops do not explain.
  const bool untold = variance < 1e-4 * whole;
  if (untold) {
    variance = whole;
    if (!model.note.empty()) model.note += "; ";
    model.note +=
        "the errors of stops and landmarks alone explain the range residuals: the noise holds them whole";
  }
  const double sigma = std::sqrt(variance);
  model.noise = shape;
  model.noise.parameters = sigma * shape.parameters;
  for (Eigen::Index i = 0; i < model.noise.parameters.size(); ++i) {
    Estimate estimate{model.noise.parameters(i), std::nullopt};
    if (!has_sigma(law))
      estimate.std_dev = sigma * std::sqrt(beta.covariance(i, i));
    else if (dof > 0.0 && !untold)
      estimate.std_dev =
          residual_spread(samples, landmark_covariance, model.alpha, gain, terms, dof_within, variance) /
          (2.0 * sigma);
    model.noise_estimates.push_back(estimate);
  }
}

/// G of alpha = G^T y, one row per sample.
MatrixXd curve_gain(const std::vector<RangeSample>& samples, const std::vector<double>& weights,
                    const MatrixXd& cofactor) {
  MatrixXd gain(static_cast<Eigen::Index>(samples.size()), cofactor.rows());
  for (std::size_t k = 0; k < samples.size(); ++k)
    gain.row(static_cast<Eigen::Index>(k)) =
        weights[k] * (cofactor * powers_of(samples[k].d, cofactor.rows())).transpose();
  return gain;
}

/// G^T V G, V the variances of the means: distances are exact.
MatrixXd alpha_covariance(const std::vector<RangeSample>& samples, const MatrixXd& gain,
                          const RangeModel& model) {
  const Eigen::Index p = model.alpha.size();
  MatrixXd covariance = MatrixXd::Zero(p, p);
  for (std::size_t k = 0; k < samples.size(); ++k) {
    const RangeSample& s = samples[k];
    const VectorXd G = gain.row(static_cast<Eigen::Index>(k)).transpose();
    const double spread = model.noise.spread(s.d, evaluate_polynomial(model.alpha, s.d));
    covariance.noalias() += spread * spread / s.R * G * G.transpose();
  }
  return covariance;
}

}  // namespace

double weight_of(const RangeSample& sample, RangeWeighting weighting) {
  return weighting == RangeWeighting::ordinary ? sample.R : sample.R * std::pow(sample.d, -4);
}

RangeModel fit_range_model(const std::vector<RangeSample>& samples, RangeWeighting weighting,
                           const std::vector<Eigen::Matrix2d>& landmark_covariance, std::optional<int> order,
                           const ClosedFormOptions& options) {
  std::vector<double> d, y, weights;
  double mean = 0.0, uncertainty = 0.0;
  for (const RangeSample& s : samples) {
    d.push_back(s.d);
    y.push_back(s.y);
    weights.push_back(weight_of(s, weighting));
    mean += s.d;
    uncertainty += distance_variance(s, landmark_covariance);
  }
  RangeModel model;
  if (!order) {
    OrderOptions selection;
    selection.max_order = options.max_order;
    selection.criterion = options.criterion;
    const OrderSelection selected = select_order(d, y, selection, weights);
    if (selected.outcome != Outcome::converged) {
      model.outcome = selected.outcome;
      model.reason = selected.reason;
      return model;
    }
    order = selected.order;
  }
  if (samples.size() < static_cast<std::size_t>(*order) + 2) {
    model.outcome = Outcome::too_few_data;
    model.reason = std::to_string(samples.size()) + " distances are too few for order " +
                   std::to_string(*order) + " and its noise";
    return model;
  }
  double scatter = 0.0;
  mean /= static_cast<double>(samples.size());
  for (const double distance : d) scatter += (distance - mean) * (distance - mean);
  if (*order >= 1 && !landmark_covariance.empty() && scatter < 4.0 * uncertainty) {
    model.outcome = Outcome::too_few_data;
    model.reason =
        "the distances are all alike: they differ by less than twice their uncertainty, which leaves "
        "the slope of f undetermined";
    return model;
  }
  const PolynomialFit fit = fit_polynomial(d, y, *order, weights);
  model.outcome = fit.outcome;
  model.reason = fit.reason;
  if (!fit.usable()) return model;
  model.alpha = fit.alpha;
  const MatrixXd gain = curve_gain(samples, weights, fit.cofactor);
  fit_noise(samples, landmark_covariance, gain, options.noise_law, model);
  if (landmark_covariance.empty()) model.alpha_covariance = alpha_covariance(samples, gain, model);
  return model;
}

}  // namespace rangecal
