// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/effect_correction.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <utility>

#include "correction/stretches.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/effects/reading_chain.hpp"

namespace rangecal {
namespace {

double known(double value, double otherwise) { return std::isfinite(value) ? value : otherwise; }

/// Half the width of a difference in parameter j. The tangent, since parameters that depend on each other cancel in it
/// alone; the standard deviation only where the effect jumps at a distance that j sets, which has no slope.
double slope_step(const Effect& effect, const Eigen::VectorXd& p, Eigen::Index j, double std_dev) {
  Eigen::VectorXd up = p, down = p;
  up[j] += std_dev;
  down[j] -= std_dev;
  const bool jumps =
      std::abs(effect.switching_distance(up.data()) - effect.switching_distance(down.data())) > 0.0;
  return jumps ? std_dev : difference_step(effect.info().parameters[static_cast<std::size_t>(j)], p[j]);
}

}  // namespace

bool EffectCorrector::takes_effects_as_exact() const {
  const bool moves = std::any_of(active_.begin(), active_.end(), [](const Active& active) {
    return active.effect->info().kind == EffectKind::mean;
  });
  return moves && !calibration_.effects_covariance;
}

EffectCorrector::EffectCorrector(const Calibration& calibration, std::vector<std::string> covariates)
    : calibration_(calibration) {
  context_.kind = calibration.kind;
  context_.range_min_m = calibration.range_min_m;
  context_.range_max_m = calibration.range_max_m;
  if (const auto times = calibration.effects_range.find("time_s"); times != calibration.effects_range.end())
    context_.duration_s = times->second.second;
  context_.stop_count = static_cast<int>(calibration.stops.size());
  context_.landmark_labels = labels_of_landmarks(calibration);
  context_.landmark_count = static_cast<int>(context_.landmark_labels.size());
  context_.landmark_radius_m.assign(context_.landmark_labels.size(), 0.0);
  context_.covariates = std::move(covariates);
  std::vector<std::pair<std::string, const Effect*>> effects;
  for (const auto& [id, values] : calibration.effects) {
    effects.emplace_back(id, find_effect(id));
    if (!effects.back().second)
      throw InputError("the calibration holds the effect " + id + ", which is in no catalogue");
  }
  std::stable_sort(effects.begin(), effects.end(), [](const auto& a, const auto& b) {
    return a.second->info().stage < b.second->info().stage;
  });
  for (const auto& [id, effect] : effects) {
    const std::map<std::string, double>& values = calibration.effects.at(id);
    const auto& info = effect->info().parameters;
    Eigen::VectorXd p = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(info.size()));
    for (std::size_t j = 0; j < info.size(); ++j) {
      const auto value = values.find(info[j].name);
      if (value == values.end())
        throw InputError("the calibration's effect " + id + " lacks its parameter " + info[j].name);
      p[static_cast<Eigen::Index>(j)] = value->second;
    }
    if (effect->noise_before_reciprocal()) continue;  // a change of the skew alone
    if (const auto& known = calibration.effects_covariance)
      for (std::size_t j = 0; j < info.size(); ++j)
        for (std::size_t k = 0; k < known->parameters.size(); ++k) {
          if (known->parameters[k] != id + "." + info[j].name) continue;
          const Eigen::Index row = calibration.alpha.size() + static_cast<Eigen::Index>(k);
          if (const double variance = known->matrix(row, row); variance > 0.0)
            estimated_.push_back({active_.size(), static_cast<Eigen::Index>(j), row,
                                  slope_step(*effect, p, static_cast<Eigen::Index>(j), std::sqrt(variance))});
        }
    active_.push_back({effect, p});
  }
}

ReadingView<double> EffectCorrector::view(double d, const ReadingSetting& setting) const {
  ReadingView<double> at;
  at.d = d;
  at.radius = known(setting.radius_m, 0.0);
  at.axis_distance = d + at.radius;
  at.bearing = known(setting.bearing_rad, 0.0);
  const CurveDerivatives curve = curve_derivatives(calibration_.alpha, calibration_.scale, d);
  at.f = curve.f;
  at.slope = curve.slope;
  at.curvature = curve.curvature;
  at.spread = calibration_.noise.spread(d, at.f);
  at.spread_power = calibration_.noise.power_of_f();
  at.heading = known(setting.heading_rad, 0.0);
  at.time_s = known(setting.time_s, 0.0);
  at.stop = setting.stop;
  at.landmark = setting.landmark;
  at.repeat = setting.repeat;
  at.covariate = setting.covariates.empty() ? nullptr : setting.covariates.data();
  at.context = &context_;
  return at;
}

ReadingChange<double> EffectCorrector::change(double d, const ReadingSetting& setting) const {
  return changed_by(active_, view(d, setting));
}

ReadingChange<double> EffectCorrector::changed_by(const std::vector<Active>& effects,
                                                  const ReadingView<double>& at) {
  ReadingChain chain;
  for (const Active& active : effects) chain.add(*active.effect, active.parameters.data(), at);
  return chain.sum();
}

ReadingView<double> EffectCorrector::seen_by(const Active& active, const ReadingView<double>& at) const {
  ReadingChain chain;
  for (const Active& earlier : active_)
    if (earlier.effect->info().stage < active.effect->info().stage)
      chain.add(*earlier.effect, earlier.parameters.data(), at);
  return chain.seen(at);
}

Eigen::VectorXd EffectCorrector::slopes_in_alpha(double d, const ReadingSetting& setting) const {
  const Eigen::Index n = calibration_.alpha.size();
  const ReadingView<double> at = view(d, setting);
  // What the effects add depends on alpha through f, f' and f'' alone.
  const auto slope_by = [&](double ReadingView<double>::*value) {
    const double step = 1e-6 * std::max(1.0, std::abs(at.*value));
    const auto range = [&](double h) {
      ReadingView<double> there = at;
      there.*value += h;
      there.spread = calibration_.noise.spread(d, there.f);
      return changed_by(active_, there).range;
    };
    return (range(step) - range(-step)) / (2.0 * step);
  };
  const double by_f = 1.0 + slope_by(&ReadingView<double>::f),
               by_slope = slope_by(&ReadingView<double>::slope),
               by_curvature = slope_by(&ReadingView<double>::curvature);
  const CurveScale& scale = calibration_.scale;
  const double u_slope = scale.slope(d);
  const Eigen::VectorXd power = powers_of(scale.of(d), n);
  Eigen::VectorXd slopes = by_f * power;
  const double by_first = by_slope * u_slope + by_curvature * scale.curvature(d),
               by_second = by_curvature * u_slope * u_slope;
  for (Eigen::Index i = 1; i < n; ++i) slopes[i] += by_first * static_cast<double>(i) * power[i - 1];
  for (Eigen::Index i = 2; i < n; ++i)
    slopes[i] += by_second * static_cast<double>(i * (i - 1)) * power[i - 2];
  return slopes;
}

std::optional<double> EffectCorrector::mean_variance(double d, const ReadingSetting& setting) const {
  if (active_.empty() || !calibration_.effects_covariance) return curve_variance(calibration_, d);
  const Eigen::MatrixXd& C = calibration_.effects_covariance->matrix;
  Eigen::VectorXd h = Eigen::VectorXd::Zero(C.rows());
  h.head(calibration_.alpha.size()) = slopes_in_alpha(d, setting);
  const ReadingView<double> at = view(d, setting);
  std::vector<Active> effects = active_;
  for (const Estimated& estimated : estimated_) {
    double& parameter = effects[estimated.active].parameters[estimated.parameter];
    const double estimate = parameter;
    const auto range = [&](double step) {
      parameter = estimate + step;
      return changed_by(effects, at).range;
    };
    h[estimated.row] = (range(estimated.step) - range(-estimated.step)) / (2.0 * estimated.step);
    parameter = estimate;
  }
  const double variance = h.dot(C * h) + shape_variance(calibration_, d);
  return std::isfinite(variance) ? std::optional(std::max(0.0, variance)) : std::nullopt;
}

EffectCorrector::Expected EffectCorrector::at(double d, const ReadingSetting& setting) const {
  const double f = calibration_.f(d), s = calibration_.noise.spread(d, f);
  const double curve = mean_variance(d, setting).value_or(0.0);
  if (active_.empty()) return {f, std::sqrt(s * s + curve), s};
  const ReadingChange<double> own = change(d, setting);
  const double noise = s * std::exp(0.5 * own.range_log_variance);
  return {f + own.range, std::sqrt(noise * noise + curve), noise};
}

std::vector<double> EffectCorrector::turning_points(double low_m, double high_m) const {
  std::vector<double> points = turning_points_of(calibration_, low_m, high_m);
  std::erase_if(points, [&](double d) { return d <= low_m || d >= high_m; });
  return points;
}

std::vector<double> EffectCorrector::turning_points(double low_m, double high_m, double reading_m,
                                                    const ReadingSetting& setting) const {
  std::vector<double> points = turning_points(low_m, high_m);
  if (active_.empty()) return points;
  const double log_variance = change(std::min(reading_m, high_m), setting).range_log_variance;
  const double reach =
      12.0 * spread_near(reading_m, low_m, high_m) * std::exp(0.5 * std::max(0.0, log_variance));
  const std::vector<Stretch> stretches =
      stretches_near(mean_reading(setting), {low_m, high_m}, reading_m, reach);
  std::erase_if(points, [&](double d) {  // there the effects say where the mean turns
    return std::any_of(stretches.begin(), stretches.end(),
                       [d](const Stretch& s) { return d >= s.from && d <= s.to; });
  });
  for (const Stretch& stretch : stretches)
    if (stretch.ends != Stretch::End::window) points.push_back(stretch.to);
  std::sort(points.begin(), points.end());
  return points;
}

double EffectCorrector::spread_near(double reading_m, double low_m, double high_m) const {
  const auto f = [&](double d) { return calibration_.f(d); };
  double largest = std::max(f(low_m), f(high_m));
  for (const double d : turning_points(low_m, high_m)) largest = std::max(largest, f(d));
  const double at = largest > 0.0 ? std::min(reading_m, largest) : reading_m;
  return calibration_.noise.spread(at, at);
}

MeanReading EffectCorrector::mean_reading(const ReadingSetting& setting) const {
  MeanReading mean{calibration_, {}, {}};
  for (const Active& active : active_) {
    const double* p = active.parameters.data();
    mean.changes.push_back([this, &active, &setting, p](double d) {
      return active.effect->reading(seen_by(active, view(d, setting)), p).range;
    });
    if (const double jump = active.effect->switching_distance(p); std::isfinite(jump))
      mean.jumps.push_back(jump);
  }
  return mean;
}

CorrectionRoot EffectCorrector::root_at(double d, double reading_m, const ReadingSetting& setting,
                                        double h) const {
  CorrectionRoot root;
  root.distance_m = d;
  root.extrapolated = is_extrapolated(calibration_, d);
  const double f = calibration_.f(d);
  const ReadingChange<double> own = change(d, setting);
  const double s = calibration_.noise.spread(d, f) * std::exp(0.5 * own.range_log_variance);
  const double z = (reading_m - f - own.range) / s;
  const std::optional<double> variance = mean_variance(d, setting);
  root.off = standard_deviations_off(reading_m - f - own.range, s, variance.value_or(0.0));
  root.log_likelihood =
      s > 0.0 ? -std::log(s) - 0.5 * z * z - half_log_two_pi : std::numeric_limits<double>::infinity();
  const double slope = std::abs(calibration_.slope(d) +
                                (change(d + h, setting).range - change(d - h, setting).range) / (2.0 * h));
  if (!(slope > 0.0)) return root;
  root.std_dev_m = s / slope;
  if (variance) root.std_dev_total_m = std::sqrt(s * s + *variance) / slope;
  return root;
}

Correction EffectCorrector::correct(double reading_m, const ReadingSetting& setting,
                                    const CorrectionOptions& options) const {
  if (active_.empty()) return rangecal::correct(calibration_, reading_m, options);
  const SearchedRange range = searched_range(calibration_, reading_m, options);
  const MeanReading mean = mean_reading(setting);
  const double y = reading_m, h = 1e-7 * range.width();
  constexpr double far = 8.0;  // standard deviations
  const double spread = spread_near(y, range.low, range.high);
  const std::vector<Stretch> stretches = stretches_near(mean, range, y, far * spread);
  const auto root = [&](double d) { return root_at(d, y, setting, h); };
  const auto nll = [&](double d) { return -root(d).log_likelihood; };

  Correction result;
  std::optional<double> nearest;
  double at_nearest = 0.0;
  const auto consider = [&](double d, double at) {
    if (nearest && !is_nearer(at, at_nearest, y)) return;
    at_nearest = at;
    nearest = d;
  };
  const auto add = [&](std::vector<CorrectionRoot>& roots, CorrectionRoot next) {
    if (roots.empty() || next.distance_m - roots.back().distance_m > 1e-9 * range.width())
      roots.push_back(std::move(next));
  };
  for (const Stretch& stretch : stretches) {
    consider(stretch.from, stretch.at_from);
    consider(stretch.to, stretch.at_to);
    const double from = stretch.at_from - y, to = stretch.at_to - y;
    if (from * to <= 0.0) {
      std::uintmax_t steps = 100;
      const auto [a, b] = boost::math::tools::toms748_solve(
          [&](double d) { return mean.at(d) - y; }, stretch.from, stretch.to, from, to,
          boost::math::tools::eps_tolerance<double>(50), steps);
      const CorrectionRoot found = root(0.5 * (a + b));
      add(result.least_squares, found);
      const double wide = found.std_dev_m ? far * *found.std_dev_m : stretch.to - stretch.from;
      const double low = std::max(stretch.from, found.distance_m - wide);
      const double high = std::min(stretch.to, found.distance_m + wide);
      if (spread > 0.0)
        add(result.maximum_likelihood, root(boost::math::tools::brent_find_minima(nll, low, high, 40).first));
    } else if (stretch.ends == Stretch::End::turn && std::abs(to) < std::abs(from) && spread > 0.0) {
      CorrectionRoot turning = root(stretch.to);  // g comes nearest here, and turns back
      turning.turning_point = true;
      turning.std_dev_m.reset();
      turning.std_dev_total_m.reset();
      add(result.maximum_likelihood, turning);
    }
  }
  result.best_least_squares = most_likely(result.least_squares);
  result.best_maximum_likelihood = most_likely(result.maximum_likelihood);
  if (!result.least_squares.empty()) {
    result.outcome = Outcome::converged;
    return result;
  }
  if (stretches.empty())
    for (const double d : {range.low, range.high}) consider(d, mean.at(d));
  for (const double d : turning_points(range.low, range.high)) consider(d, mean.at(d));
  if (nearest) result.nearest = root(*nearest);
  result.reason =
      fmt::format("no distance between {} and {} m is read as {} m, effects counted; the nearest is given",
                  range.low, range.high, y);
  result.outcome = result.maximum_likelihood.empty() ? Outcome::failed : Outcome::converged;
  return result;
}

}  // namespace rangecal
