// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/effect_estimates.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/length_interval.hpp"
#include "diagnosis/phase_interval.hpp"
#include "diagnosis/projector.hpp"
#include "diagnosis/signatures.hpp"
#include "diagnosis/working.hpp"
#include "rangecal/core/distributions.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr const char *at_its_bound = "at its bound", *any_direction = "any: the amplitude is not told from 0";

/// Degrees of freedom of the estimates of one effect's parameters, infinity where the noise is given. Their
/// variance scales with the channels' own estimated variances, s_e^2 and s_theta^2, by the shares w and 1 - w of
/// the information that each channel brings; by Satterthwaite (1946) the estimate over its standard deviation is
/// Student's t of
///   nu = 2 / Var log(s^2),  Var log(s^2) = w^2 Var log(s_e^2) + (1 - w)^2 Var log(s_theta^2).
double freedom_of_estimates(const Rows& rows, const Projector& projector, const Fit& fit,
                            std::size_t effect) {
  double share = 0.0;
  int counted = 0;
  for (const FreeParameter& p : fit.free) {
    if (p.effect != static_cast<int>(effect) || p.acts != FreeParameter::Acts::mean) continue;
    Signature x = effect_signature(rows, projector, fit.model[effect], p.index);
    const double whole = projector.raw_information(x);
    x.bearing.setZero();
    x.bearing_rows.setZero();
    if (whole > 0.0) share += projector.raw_information(x) / whole, ++counted;
  }
  if (counted == 0) return std::numeric_limits<double>::infinity();
  share /= counted;
  const double range = share * 2.0 * fit.noise_std;
  const double bearing =
      rows.reads_bearings() ? (1.0 - share) * 2.0 * fit.sigma_theta_std / fit.state.sigma_theta_rad : 0.0;
  const double variance = range * range + bearing * bearing;
  if (!(variance > 0.0)) return std::numeric_limits<double>::infinity();
  return std::max(1.0, 2.0 / variance);
}

/// True for a parameter that is a positive scale (a time constant, a wavelength): its logarithm is the
/// better normal.
bool is_scale(const EffectInfo& info, const std::string& name) {
  return std::any_of(info.parameters.begin(), info.parameters.end(), [&](const EffectParameter& p) {
    return p.name == name && !p.linear && !p.discrete && p.low > 0.0;
  });
}

/// Limits of the effect's reported value v by its parameter's own, where it depends (`slopes`) on a single
/// one that has them.
std::optional<Limits> profile_limits(const Rows& rows, const Fit& fit, std::size_t effect, std::size_t v,
                                     const Eigen::RowVectorXd& slopes) {
  if (fit.limits.empty() || (slopes.array() != 0.0).count() != 1) return std::nullopt;
  Eigen::Index a = 0;
  slopes.cwiseAbs().maxCoeff(&a);
  const std::optional<Limits>& own = fit.limits[static_cast<std::size_t>(a)];
  if (!own) return std::nullopt;
  const auto value_at = [&](double x) {
    Eigen::VectorXd p = fit.model[effect].parameters;
    p[fit.free[static_cast<std::size_t>(a)].index] = x;
    return fit.model[effect].effect->reported(rows.context, p.data())[v].second;
  };
  const auto [low, high] = std::minmax({value_at(own->low), value_at(own->high)});
  return Limits{low, high};
}

/// Two parameters of an effect that may be a cosine and a sine, with their covariance.
struct ParameterPair {
  Eigen::Index a, b;  ///< of the free parameters
  int i, j;           ///< of the effect's
  Eigen::Vector2d at;
  Eigen::Matrix2d covariance;
};

std::vector<ParameterPair> pairs_of(const Fit& fit, std::size_t effect) {
  std::vector<Eigen::Index> own;
  for (std::size_t a = 0; a < fit.free.size(); ++a)
    if (fit.free[a].effect == static_cast<int>(effect) && fit.free[a].acts == FreeParameter::Acts::mean)
      own.push_back(static_cast<Eigen::Index>(a));
  const Eigen::VectorXd& p = fit.model[effect].parameters;
  std::vector<ParameterPair> pairs;
  for (const Eigen::Index a : own)
    for (const Eigen::Index b : own) {
      if (a >= b) continue;
      const int i = fit.free[static_cast<std::size_t>(a)].index,
                j = fit.free[static_cast<std::size_t>(b)].index;
      Eigen::Matrix2d C;
      C << fit.covariance(a, a), fit.covariance(a, b), fit.covariance(b, a), fit.covariance(b, b);
      pairs.push_back({a, b, i, j, {p[i], p[j]}, C});
    }
  return pairs;
}

/// The effect's reported value v where the pair is moved to `at`.
double value_of_pair(const Rows& rows, const Fit& fit, std::size_t effect, std::size_t v,
                     const ParameterPair& pair, const Eigen::Vector2d& at) {
  Eigen::VectorXd moved = fit.model[effect].parameters;
  moved[pair.i] = at.x(), moved[pair.j] = at.y();
  return fit.model[effect].effect->reported(rows.context, moved.data())[v].second;
}

/// True if the value depends on the pair alone.
bool of_pair_alone(const ParameterPair& pair, const Eigen::RowVectorXd& slopes) {
  for (Eigen::Index other = 0; other < slopes.size(); ++other)
    if (other != pair.a && other != pair.b && slopes[other] != 0.0) return false;
  return true;
}

/// Limits of the effect's reported value v where it is a function of the length of a pair of parameters
/// alone, an amplitude of a cosine and a sine: one that stays when the pair is turned. `widen`: factor on the
/// standard deviations.
std::optional<Limits> amplitude_limits(const Rows& rows, const Fit& fit, std::size_t effect, std::size_t v,
                                       const Eigen::RowVectorXd& slopes, double widen) {
  for (const ParameterPair& pair : pairs_of(fit, effect)) {
    const auto value_at = [&](const Eigen::Vector2d& at) {
      return value_of_pair(rows, fit, effect, v, pair, at);
    };
    const double value = value_at(pair.at), rounding = 1e-9 * std::abs(value);
    const auto stays = [&](double angle) {
      return std::abs(value_at(Eigen::Rotation2Dd(angle) * pair.at) - value) <= rounding;
    };
    if (!stays(1.0) || !stays(2.5) || std::abs(value_at(2.0 * pair.at) - value) <= rounding) continue;
    if (!of_pair_alone(pair, slopes)) return std::nullopt;
    const Limits length = length_interval(pair.at, widen * widen * pair.covariance);
    return Limits{value_at({length.low, 0.0}), value_at({length.high, 0.0})};
  }
  return std::nullopt;
}

/// A value that is a direction, and its limits: none where it may be any.
struct PhaseLimits {
  std::optional<Limits> limits;
};

/// Limits of the effect's reported value v where it is a phase: one that stays when a pair of parameters is
/// scaled and goes with its direction, by m [rad/rad] (1/2 for an axis), when the pair is turned.
std::optional<PhaseLimits> phase_limits(const Rows& rows, const Fit& fit, std::size_t effect, std::size_t v,
                                        const Eigen::RowVectorXd& slopes, double nu) {
  for (const ParameterPair& pair : pairs_of(fit, effect)) {
    if (!(pair.at.norm() > 0.0)) continue;
    const auto value_at = [&](const Eigen::Vector2d& at) {
      return value_of_pair(rows, fit, effect, v, pair, at);
    };
    const double value = value_at(pair.at);
    if (std::abs(value_at(2.0 * pair.at) - value) > 1e-9 * std::max(1.0, std::abs(value))) continue;
    constexpr double turn = 0.3;  // one of the two sides is away from the cut of atan2
    const double ahead = (value_at(Eigen::Rotation2Dd(turn) * pair.at) - value) / turn,
                 behind = (value - value_at(Eigen::Rotation2Dd(-turn) * pair.at)) / turn;
    const double m = std::abs(ahead) < std::abs(behind) ? ahead : behind;
    if (std::abs(std::abs(m) - 1.0) > 1e-6 && std::abs(std::abs(m) - 0.5) > 1e-6) continue;
    if (!of_pair_alone(pair, slopes)) return std::nullopt;
    const std::optional<Limits> angle = phase_interval(pair.at, pair.covariance, nu);
    if (!angle) return PhaseLimits{};
    const double middle = std::atan2(pair.at.y(), pair.at.x());
    const auto [low, high] =
        std::minmax({value + m * (angle->low - middle), value + m * (angle->high - middle)});
    return PhaseLimits{Limits{low, high}};
  }
  return std::nullopt;
}

/// True if a parameter that the value depends on ended at one of its bounds: there the likelihood has no quadratic
/// to read a standard deviation off. By its profile, too, where that has one limit only.
bool depends_on_a_bound(const Rows& rows, const Fit& fit, std::size_t effect,
                        const Eigen::RowVectorXd& slopes) {
  for (std::size_t a = 0; a < fit.free.size(); ++a) {
    if (fit.free[a].effect != static_cast<int>(effect) || slopes[static_cast<Eigen::Index>(a)] == 0.0)
      continue;
    if (ended_at_bound(rows, fit.model, fit.free[a])) return true;
    if (a < fit.limits.size() && fit.limits[a] && fit.limits[a]->one_sided) return true;
  }
  return false;
}

}  // namespace

std::vector<EffectEstimate> effect_estimates(const Rows& rows, const Fit& fit) {
  std::vector<EffectEstimate> estimates;
  const WorkingProblem working = working_problem(rows, fit.model, fit.state);
  const Projector projector(rows, working, fit.state);
  for (std::size_t e = 0; e < fit.model.size(); ++e) {
    const ActiveEffect& active = fit.model[e];
    const double nu = freedom_of_estimates(rows, projector, fit, e),
                 quantile = std::isinf(nu) ? z95 : student_t_quantile(0.975, nu);
    const std::string& id = active.effect->info().id;
    const auto values = active.effect->reported(rows.context, active.parameters.data());
    if (active.effect->noise_before_reciprocal()) {  // its size is the sensor's own noise
      const double sigma = fit.state.noise.parameters[0];
      estimates.push_back({id + "." + values[0].first, sigma, sigma * fit.noise_std,
                           sigma * (1.0 - z95 * fit.noise_std), sigma * (1.0 + z95 * fit.noise_std), ""});
      continue;
    }
    Eigen::MatrixXd slopes =
        Eigen::MatrixXd::Zero(static_cast<Eigen::Index>(values.size()), fit.covariance.cols());
    for (std::size_t a = 0; a < fit.free.size(); ++a) {
      if (fit.free[a].effect != static_cast<int>(e)) continue;
      Eigen::VectorXd up = active.parameters, down = up;
      const double sigma = std::sqrt(
          std::max(0.0, fit.covariance(static_cast<Eigen::Index>(a), static_cast<Eigen::Index>(a))));
      const double step = std::max(1e-3 * sigma, 1e-9 * std::max(1.0, std::abs(up[fit.free[a].index])));
      up[fit.free[a].index] += step;
      down[fit.free[a].index] -= step;
      const auto high = active.effect->reported(rows.context, up.data());
      const auto low = active.effect->reported(rows.context, down.data());
      for (std::size_t v = 0; v < values.size(); ++v) {
        double forward = high[v].second - values[v].second, backward = values[v].second - low[v].second;
        if (values[v].first.find("_rad") != std::string::npos) {  // an axis jumps by pi where it is cut
          forward = std::remainder(forward, 2.0 * std::numbers::pi);
          backward = std::remainder(backward, 2.0 * std::numbers::pi);
          constexpr double jump = 0.5;
          if (std::abs(forward - backward) > jump)
            (std::abs(forward) > std::abs(backward) ? forward : backward) =
                std::min(forward, backward, [](double x, double y) { return std::abs(x) < std::abs(y); });
        }
        slopes(static_cast<Eigen::Index>(v), static_cast<Eigen::Index>(a)) =
            (forward + backward) / (2.0 * step);
      }
    }
    for (std::size_t v = 0; v < values.size(); ++v) {
      const Eigen::RowVectorXd row = slopes.row(static_cast<Eigen::Index>(v));
      EffectEstimate estimate;
      estimate.name = id + "." + values[v].first;
      estimate.estimate = values[v].second;
      estimate.std_dev = std::sqrt(std::max(0.0, (row * fit.covariance * row.transpose()).value()));
      const double half = quantile * estimate.std_dev;
      estimate.low95 = estimate.estimate - half;
      estimate.high95 = estimate.estimate + half;
      if (is_scale(active.effect->info(), values[v].first) && estimate.estimate > 0.0) {
        estimate.low95 = estimate.estimate * std::exp(-half / estimate.estimate);
        estimate.high95 = estimate.estimate * std::exp(half / estimate.estimate);
      }
      if (const auto own = amplitude_limits(rows, fit, e, v, row, quantile / z95)) {
        estimate.low95 = own->low;
        estimate.high95 = own->high;
      }
      constexpr double unknown = std::numeric_limits<double>::quiet_NaN();
      if (const auto phase = phase_limits(rows, fit, e, v, row, nu)) {
        estimate.low95 = phase->limits ? phase->limits->low : unknown;
        estimate.high95 = phase->limits ? phase->limits->high : unknown;
        if (!phase->limits) estimate.std_dev = unknown, estimate.note = any_direction;
      }
      const auto profile = profile_limits(rows, fit, e, v, row);
      if (profile) {
        estimate.low95 = profile->low;
        estimate.high95 = profile->high;
      }
      if (depends_on_a_bound(rows, fit, e, row)) {
        estimate.std_dev = unknown;
        estimate.note = at_its_bound;
        if (!profile) estimate.low95 = estimate.high95 = unknown;
      }
      if (estimate.std_dev == 0.0)  // chosen from a list, or read off the values: its error is not known
        estimate.std_dev = estimate.low95 = estimate.high95 = unknown;
      estimates.push_back(estimate);
    }
  }
  return estimates;
}

}  // namespace rangecal::diagnosis
