// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/evidence.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <set>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/free_parameters.hpp"
#include "diagnosis/generic_effect.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double log_two_pi = 2.0 * half_log_two_pi;

/// ln of the density of N(x; 0, V); -infinity where V is not positive definite.
double log_normal_density(const Eigen::VectorXd& x, const Eigen::MatrixXd& V) {
  const Eigen::LLT<Eigen::MatrixXd> factor(V);
  if (factor.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  const Eigen::MatrixXd L = factor.matrixL();
  const double log_det = 2.0 * L.diagonal().array().log().sum();
  return -0.5 * (static_cast<double>(x.size()) * log_two_pi + log_det + x.dot(factor.solve(x)));
}

/// Values that a parameter is chosen from.
double choices(const Rows& rows, const Effect& effect, std::size_t index) {
  std::set<double> values;
  for (const Eigen::VectorXd& start : effect.start_grid(rows.context))
    values.insert(start[static_cast<Eigen::Index>(index)]);
  return std::max<double>(1.0, static_cast<double>(values.size()));
}

/// True of a time constant or a wavenumber that may be of any magnitude.
bool spans_decades(double low, double high) { return low > 0.0 && high > 100.0 * low; }

/// ln of the density of Student's t at a parameter's typical size, of its positive half where it has no sign.
double log_density_of_size(const EffectParameter& parameter, double low, double value,
                           const SelectionPriors& priors) {
  const double typical = size_of(parameter);
  const double both_signs = low >= 0.0 ? 2.0 : 1.0;
  return std::log(both_signs * boost::math::pdf(boost::math::students_t(priors.size_dof), value / typical) /
                  typical);
}

/// ln of the integral of the likelihood, over its value at the fit, times the prior density of a size that may be 0, by the
/// trapezoidal rule from its lower bound on.
double log_integral_from_bound(const Rows& rows, const Fit& fit, const FreeParameter& p,
                               const RefitOptions& options, const SelectionPriors& priors) {
  constexpr double first = 0.02, factor = 2.0, gone = 6.0;  // of the typical size; nats
  const EffectParameter& info = info_of(fit.model, p);
  const auto [low, high] = bounds_of(rows, fit.model, p);
  const double typical = size_of(info);
  double integral = 0.0, x_before = low, density_before = -1.0;
  for (double offset = 0.0;; offset = offset > 0.0 ? factor * offset : first * typical) {
    const double x = std::min(low + offset, high);
    Model model = fit.model;
    value_of(model, p) = std::max(x, 1e-9 * typical);
    JointState state = fit.state;
    const double rise = calibrate_under(rows, model, state, options) - fit.nll;
    const double density = std::isfinite(rise)
                               ? std::exp(-std::max(0.0, rise) + log_density_of_size(info, low, x, priors))
                               : 0.0;
    if (density_before >= 0.0) integral += 0.5 * (x - x_before) * (density + density_before);
    x_before = x, density_before = density;
    if (x >= high || !(rise < gone)) break;
  }
  return std::log(std::max(integral, 1e-300));
}

/// ln of sqrt(2 pi) times standard deviation times prior density of a parameter that only the value of the likelihood
/// knows; of a size so small that the likelihood does not see it, the integral from its bound on.
double log_volume_of_numeric(const Rows& rows, const Fit& fit, const FreeParameter& p,
                             const RefitOptions& options, const SelectionPriors& priors) {
  const EffectParameter& info = info_of(fit.model, p);
  const auto [low, high] = bounds_of(rows, fit.model, p);
  const double value = fit.model[p.effect].parameters[p.index];
  const bool positive = low >= 0.0 && value > 0.0;
  const double reach = positive ? std::log(1.3) : 0.3 * size_of(info);
  RefitOptions staying = options;
  staying.places_stay = true;
  double rise = 0.0;
  int sides = 0;
  for (const int side : {-1, 1}) {
    Model model = fit.model;
    const double moved = positive ? value * std::exp(side * reach) : value + side * reach;
    if (moved < low || moved > high) continue;
    value_of(model, p) = moved;
    JointState state = fit.state;
    const double nll = calibrate_under(rows, model, state, staying);
    if (!std::isfinite(nll)) continue;
    rise += std::max(0.0, nll - fit.nll);
    ++sides;
  }
  // value +- reach raises the NLL by reach^2 / (2 sigma^2)
  constexpr double widest = 1.0;   // an e-fold, or as many typical sizes as `reach` is parts of one
  constexpr double unseen = 0.02;  // nats, for a factor of 1.3
  if (positive && rise < unseen && value < size_of(info))
    return std::min(0.0, log_integral_from_bound(rows, fit, p, staying, priors));
  const double sigma =
      sides == 0 || !(rise > 0.0) ? widest : std::min(widest, reach / std::sqrt(2.0 * rise / sides));
  const double density = log_density_of_size(info, low, value, priors) + (positive ? std::log(value) : 0.0);
  return std::min(0.0, 0.5 * log_two_pi + std::log(sigma) + density);
}

/// ln N(c; 0, S + T) of the parameters of curves, free.at(i) for i in `of_curves`; T = tau^2 I of each curve, its size tau
/// the likeliest by its own parameters alone.
double log_density_of_curves(const Fit& fit, const std::vector<Eigen::Index>& of_curves) {
  const auto m = static_cast<Eigen::Index>(of_curves.size());
  const auto free = [&](Eigen::Index i) -> const FreeParameter& {
    return fit.free[static_cast<std::size_t>(of_curves[static_cast<std::size_t>(i)])];
  };
  Eigen::VectorXd c(m);
  Eigen::MatrixXd V(m, m);
  for (Eigen::Index i = 0; i < m; ++i) {
    c[i] = fit.model[free(i).effect].parameters[free(i).index];
    for (Eigen::Index j = 0; j < m; ++j)
      V(i, j) =
          fit.covariance(of_curves[static_cast<std::size_t>(i)], of_curves[static_cast<std::size_t>(j)]);
  }
  for (Eigen::Index begin = 0, end = 0; begin < m; begin = end) {
    while (end < m && free(end).effect == free(begin).effect) ++end;
    const Eigen::Index size = end - begin;
    const Eigen::VectorXd own = c.segment(begin, size);
    const Eigen::MatrixXd S = V.block(begin, begin, size, size);
    const double rms = own.norm() / std::sqrt(static_cast<double>(size));
    double best = -std::numeric_limits<double>::infinity(), variance = 0.0;
    for (const double share : {0.01, 0.03, 0.1, 0.3, 0.6, 1.0, 1.5}) {
      const double tau = share * rms;
      const double density = log_normal_density(own, S + tau * tau * Eigen::MatrixXd::Identity(size, size));
      if (density > best) best = density, variance = tau * tau;
    }
    V.block(begin, begin, size, size).diagonal().array() += variance;
  }
  return log_normal_density(c, V);
}

/// ln det (C^-1 + wide^-2)^-1 = ln det C - ln det (C + wide^2) + ln det wide^2 of a covariance C and the standard deviations `wide`
/// of priors, which a parameter that the readings do not tell has. In units of `wide`, so that none is lost in the rounding of
/// another; one that its own rounding hides counts as that.
double log_det_within(const Eigen::MatrixXd& C, const Eigen::VectorXd& wide) {
  if (!C.allFinite()) return -std::numeric_limits<double>::infinity();
  const Eigen::Index k = wide.size();
  const Eigen::VectorXd scale = wide.cwiseInverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * C * scale.asDiagonal();
  const auto log_det = [&](const Eigen::MatrixXd& V) {
    const Eigen::LDLT<Eigen::MatrixXd> factor(V);
    const Eigen::VectorXd own = factor.transpositionsP() * V.diagonal();
    const Eigen::VectorXd rounding = std::numeric_limits<double>::epsilon() * own;
    return factor.vectorD().cwiseMax(rounding).array().log().sum();
  };
  return log_det(scaled) - log_det(scaled + Eigen::MatrixXd::Identity(k, k)) + 2.0 * wide.array().log().sum();
}

}  // namespace

double log_prior_density(const EffectParameter& parameter, double low, double high, double value,
                         const SelectionPriors& priors) {
  if (parameter.linear || !std::isfinite(high - low))
    return log_density_of_size(parameter, low, value, priors);
  return spans_decades(low, high) ? -std::log(value * std::log(high / low)) : -std::log(high - low);
}

double log_prior_density(const Rows& rows, const Effect& effect, const std::vector<int>& indices,
                         const Eigen::VectorXd& parameters, const SelectionPriors& priors) {
  double density = 0.0, squares = 0.0, alike = 0.0;
  for (const int j : indices) {
    const EffectParameter& parameter = effect.info().parameters[static_cast<std::size_t>(j)];
    if (effect.info().sizes_alike && parameter.linear) {
      squares += std::pow(parameters[j] / size_of(parameter), 2);
      density -= std::log(size_of(parameter));
      alike += 1.0;
      continue;
    }
    const auto [low, high] = effect.bounds(rows.context, static_cast<std::size_t>(j));
    density += log_prior_density(parameter, low, high, parameters[j], priors);
  }
  const double dof = priors.size_dof;
  return density + boost::math::lgamma(0.5 * (dof + alike)) - boost::math::lgamma(0.5 * dof) -
         0.5 * alike * std::log(dof * std::numbers::pi) - 0.5 * (dof + alike) * std::log1p(squares / dof);
}

double prior_width(const EffectParameter& parameter, double low, double high, double value) {
  if (!parameter.linear && std::isfinite(high - low))
    return (spans_decades(low, high) ? value * std::log(high / low) : high - low) / std::sqrt(12.0);
  return std::max(size_of(parameter), std::abs(value));
}

double prior_width(const Rows& rows, const Model& model, const FreeParameter& p) {
  const auto [low, high] = bounds_of(rows, model, p);
  const ActiveEffect& active = model[static_cast<std::size_t>(p.effect)];
  // Of a curve's parameters, whose own prior is that of the curve's size: as wide as they may be.
  return is_generic(*active.effect) ? high - low
                                    : prior_width(info_of(model, p), low, high, active.parameters[p.index]);
}

MemberCounts count_members(const Rows& rows, double places) {
  MemberCounts counts;
  counts.places = std::max(1.0, places);
  const std::vector<const Effect*> effects = effects_of(rows.context);
  counts.names = static_cast<double>(std::count_if(effects.begin(), effects.end(), [&](const Effect* effect) {
    return !is_bookkeeping(effect->info().kind) && effect->lacking(rows.context).empty();
  }));
  counts.names = std::max(1.0, counts.names);
  return counts;
}

double log_prior_mass(const Model& model, std::size_t known, const MemberCounts& counts,
                      const SelectionPriors& priors) {
  double mass = 0.0;
  for (std::size_t i = known; i < model.size(); ++i) {
    mass += is_generic(*model[i].effect) ? std::log(priors.further_member * priors.generic / counts.places)
                                         : log_prior_of_one_more_name(counts, priors);
    if (i == known) mass -= std::log(priors.further_member);
  }
  return mass;
}

double log_prior_of_one_more_name(const MemberCounts& counts, const SelectionPriors& priors) {
  return std::log(priors.further_member * (1.0 - priors.generic) / counts.names);
}

double log_calibration_volume(const Rows& rows, const Fit& fit) {
  return Projector(rows, working_problem(rows, fit.model, fit.state), fit.state).log_phi_volume();
}

double log_parameter_volume(const Rows& rows, const Fit& fit, std::size_t known, const RefitOptions& options,
                            const SelectionPriors& priors) {
  double volume = 0.0;
  std::vector<Eigen::Index> joint, curve;    // into fit.free: all that have a covariance; of curves
  std::map<int, std::vector<int>> of_names;  // their parameters that have a covariance
  std::set<std::pair<int, int>> free;
  for (std::size_t a = 0; a < fit.free.size(); ++a) {
    const FreeParameter& p = fit.free[a];
    free.emplace(p.effect, p.index);
    if (static_cast<std::size_t>(p.effect) < known) continue;
    if (p.acts == FreeParameter::Acts::numeric) {
      volume += log_volume_of_numeric(rows, fit, p, options, priors);
      continue;
    }
    joint.push_back(static_cast<Eigen::Index>(a));
    if (is_generic(*fit.model[static_cast<std::size_t>(p.effect)].effect))
      curve.push_back(static_cast<Eigen::Index>(a));
    else
      of_names[p.effect].push_back(p.index);
  }
  for (const auto& [e, indices] : of_names) {
    const ActiveEffect& name = fit.model[static_cast<std::size_t>(e)];
    volume += log_prior_density(rows, *name.effect, indices, name.parameters, priors);
  }
  for (std::size_t e = known; e < fit.model.size(); ++e) {
    const auto& parameters = fit.model[e].effect->info().parameters;
    if (const auto* of_curve = dynamic_cast<const GenericEffect*>(fit.model[e].effect))
      volume -= std::log(of_curve->choices);
    for (std::size_t j = 0; j < parameters.size(); ++j)
      if (!free.count({static_cast<int>(e), static_cast<int>(j)}) && !parameters[j].linear)
        volume -= std::log(choices(rows, *fit.model[e].effect, j));
  }
  if (joint.empty()) return volume;
  const auto k = static_cast<Eigen::Index>(joint.size());
  Eigen::MatrixXd C(k, k);
  Eigen::VectorXd wide(k);  // standard deviations of the priors: no parameter is less certain than that
  for (Eigen::Index i = 0; i < k; ++i) {
    wide[i] = prior_width(rows, fit.model, fit.free[static_cast<std::size_t>(joint[i])]);
    for (Eigen::Index j = 0; j < k; ++j) C(i, j) = fit.covariance(joint[i], joint[j]);
  }
  volume += 0.5 * (static_cast<double>(k) * log_two_pi + log_det_within(C, wide));
  return curve.empty() ? volume : volume + log_density_of_curves(fit, curve);
}

}  // namespace rangecal::diagnosis
