// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/evidence.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>

#include "diagnosis/bookkeeping.hpp"
#include "diagnosis/free_parameters.hpp"
#include "diagnosis/generic_effect.hpp"

namespace rangecal::diagnosis {
namespace {

const double log_two_pi = std::log(2.0 * std::numbers::pi);

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

/// ln of sqrt(2 pi) times standard deviation times prior density of a parameter that only the value of the likelihood
/// knows.
double log_volume_of_numeric(const Rows& rows, const Fit& fit, const FreeParameter& p,
                             const RefitOptions& options, const SelectionPriors& priors) {
  const EffectParameter& info = info_of(fit.model, p);
  const auto [low, high] = bounds_of(rows, fit.model, p);
  const double value = fit.model[p.effect].parameters[p.index];
  const bool positive = low >= 0.0 && value > 0.0;
  const double reach = positive ? std::log(1.3) : 0.3 * std::max(std::abs(info.typical), 1e-9);
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
  constexpr double widest = 1.0;  // an e-fold, or as many typical sizes as `reach` is parts of one
  const double sigma =
      sides == 0 || !(rise > 0.0) ? widest : std::min(widest, reach / std::sqrt(2.0 * rise / sides));
  const double density =
      log_prior_density(info, low, high, value, priors) + (positive ? std::log(value) : 0.0);
  return std::min(0.0, 0.5 * log_two_pi + std::log(sigma) + density);
}

}  // namespace

double log_prior_density(const EffectParameter& parameter, double low, double high, double value,
                         const SelectionPriors& priors) {
  if (!parameter.linear && std::isfinite(high - low)) return -std::log(high - low);
  const double typical = std::max(std::abs(parameter.typical), 1e-12);
  const double both_signs = low >= 0.0 ? 2.0 : 1.0;
  return std::log(both_signs * boost::math::pdf(boost::math::students_t(priors.size_dof), value / typical) /
                  typical);
}

double prior_width(const EffectParameter& parameter, double low, double high, double value) {
  if (!parameter.linear && std::isfinite(high - low)) return (high - low) / std::sqrt(12.0);
  return std::max({std::abs(parameter.typical), std::abs(value), 1e-12});
}

MemberCounts count_members(const Rows& rows, double places) {
  MemberCounts counts;
  counts.places = std::max(1.0, places);
  counts.names = static_cast<double>(
      std::count_if(effect_registry().begin(), effect_registry().end(), [&](const auto& effect) {
        return !is_bookkeeping(effect->info().kind) && effect->missing(rows.context).empty();
      }));
  counts.names = std::max(1.0, counts.names);
  return counts;
}

double log_prior_mass(const Model& model, std::size_t known, const MemberCounts& counts,
                      const SelectionPriors& priors) {
  double mass = 0.0;
  for (std::size_t i = known; i < model.size(); ++i) {
    mass += is_nameless(*model[i].effect) ? std::log(priors.nameless / counts.places)
                                          : std::log((1.0 - priors.nameless) / counts.names);
    if (i > known) mass += std::log(priors.further_member);
  }
  return mass;
}

double log_parameter_volume(const Rows& rows, const Fit& fit, std::size_t known, const RefitOptions& options,
                            const SelectionPriors& priors) {
  double volume = 0.0;
  std::vector<Eigen::Index> joint, curve;  // into fit.free: all that have a covariance; of curves
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
    if (is_nameless(*fit.model[static_cast<std::size_t>(p.effect)].effect))
      curve.push_back(static_cast<Eigen::Index>(a));
    else {
      const auto [low, high] = bounds_of(rows, fit.model, p);
      volume += log_prior_density(info_of(fit.model, p), low, high, fit.model[p.effect].parameters[p.index],
                                  priors);
    }
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
    const FreeParameter& p = fit.free[static_cast<std::size_t>(joint[i])];
    const EffectParameter& info = info_of(fit.model, p);
    const auto [low, high] = bounds_of(rows, fit.model, p);
    const double value = fit.model[p.effect].parameters[p.index];
    // The prior of a curve's parameters comes below.
    wide[i] = is_nameless(*fit.model[p.effect].effect) ? high - low : prior_width(info, low, high, value);
    for (Eigen::Index j = 0; j < k; ++j) C(i, j) = fit.covariance(joint[i], joint[j]);
  }
  // (C^-1 + wide^-2)^-1 = C - C (C + wide^2)^-1 C
  const Eigen::MatrixXd sum = C + Eigen::MatrixXd(wide.cwiseAbs2().asDiagonal());
  const Eigen::LLT<Eigen::MatrixXd> of_sum(sum);
  if (of_sum.info() != Eigen::Success) return -std::numeric_limits<double>::infinity();
  const Eigen::MatrixXd scale = wide.cwiseInverse().asDiagonal();
  const Eigen::MatrixXd within = scale * (C - C * of_sum.solve(C)) * scale;
  const Eigen::LDLT<Eigen::MatrixXd> factor(within);
  double log_det = 2.0 * wide.array().log().sum();
  for (Eigen::Index i = 0; i < k; ++i) log_det += std::log(std::max(factor.vectorD()[i], 1e-300));
  volume += 0.5 * (static_cast<double>(k) * log_two_pi + log_det);
  if (curve.empty()) return volume;
  const auto m = static_cast<Eigen::Index>(curve.size());
  Eigen::VectorXd c(m);
  Eigen::MatrixXd S(m, m);
  for (Eigen::Index i = 0; i < m; ++i) {
    const FreeParameter& p = fit.free[static_cast<std::size_t>(curve[i])];
    c[i] = fit.model[p.effect].parameters[p.index];
    for (Eigen::Index j = 0; j < m; ++j) S(i, j) = fit.covariance(curve[i], curve[j]);
  }
  double best = -std::numeric_limits<double>::infinity();
  const double rms = c.norm() / std::sqrt(static_cast<double>(m));
  for (const double share : {0.1, 0.3, 0.6, 1.0, 1.5}) {
    const double tau = share * rms;
    best = std::max(best, log_normal_density(c, S + tau * tau * Eigen::MatrixXd::Identity(m, m)));
  }
  return volume + best;
}

}  // namespace rangecal::diagnosis
