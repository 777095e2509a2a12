// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/unseen.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "diagnosis/settled_by.hpp"
#include "in_parallel.hpp"

namespace rangecal::diagnosis {
namespace {

/// Name and value of the size as the user reads them.
std::pair<std::string, double> size_of(const Space& space, const TypicalEffect& typical, double factor) {
  const ActiveEffect active = scaled(typical, factor);
  if (typical.index >= 0)
    return {active.effect->info().parameters[static_cast<std::size_t>(typical.index)].name,
            active.parameters[typical.index]};
  const auto values = active.effect->reported(space.rows().context, active.parameters.data());
  for (const auto& value : values)  // the first that is not 0
    if (value.second != 0.0) return value;
  return values.front();
}

bool within_bounds(const ActiveEffect& active) {
  const auto& parameters = active.effect->info().parameters;
  for (std::size_t j = 0; j < parameters.size(); ++j)
    if (!parameters[j].discrete &&
        std::abs(active.parameters[static_cast<Eigen::Index>(j)]) >
            1.0001 * std::max(std::abs(parameters[j].high), std::abs(parameters[j].low)))
      return false;
  return true;
}

/// As factor_to below, for a limit beyond which readings are missing: the lower the limit, the larger the effect.
std::optional<double> factor_of_limit(const Space& space, const TypicalEffect& typical, double threshold) {
  const auto at = [&](double factor) {
    const ActiveEffect active = scaled(typical, factor);
    return space.change({active}).information + shape_noncentrality(space, active);
  };
  double low = 1.0, high = 1.0;
  for (int step = 0; step < 30 && at(low) < threshold; ++step) {
    high = low;
    low *= 0.93;
  }
  if (at(low) < threshold) return std::nullopt;
  for (int step = 0; step < 8; ++step) (at(0.5 * (low + high)) < threshold ? high : low) = 0.5 * (low + high);
  return low;
}

/// Factor on the typical size at which the noncentrality reaches the threshold.
std::optional<double> factor_to(const Space& space, const TypicalEffect& typical, double threshold) {
  if (typical.active.effect->info().kind == EffectKind::detection)
    return factor_of_limit(space, typical, threshold);
  const double mean = typical.direction.information;
  if (typical.noncentrality - mean < 1e-9) {  // means and variances: quadratic in the size
    const double floor = 1e-6 * std::max(typical.direction.raw, 1e-300);
    if (!(mean > floor)) return std::nullopt;
    const double factor = std::sqrt(threshold / mean);
    return within_bounds(scaled(typical, factor)) ? std::optional(factor) : std::nullopt;
  }
  if (scaled(typical, 2.0).parameters == typical.active.parameters)
    return std::nullopt;  // its size cannot be changed
  double low = 1.0, high = 1.0;
  const auto at = [&](double factor) {
    const ActiveEffect active = scaled(typical, factor);
    return factor * factor * mean + shape_noncentrality(space, active);
  };
  for (int doubling = 0; doubling < 8 && at(high) < threshold; ++doubling) {
    low = high;
    high *= 2.0;
    if (within_bounds(scaled(typical, high))) continue;
    double beyond = high;  // find the largest size within bounds by bisection
    high = low;
    for (int step = 0; step < 20; ++step)
      (within_bounds(scaled(typical, 0.5 * (high + beyond))) ? high : beyond) = 0.5 * (high + beyond);
    break;
  }
  if (at(high) < threshold) return std::nullopt;
  for (int step = 0; step < 8; ++step) (at(0.5 * (low + high)) < threshold ? low : high) = 0.5 * (low + high);
  return high;
}

}  // namespace

std::vector<TypicalEffect> catalogue_of(const Space& space) {
  const std::vector<const Effect*> registry = effects_of(space.rows().context);
  std::vector<std::optional<TypicalEffect>> typical(registry.size());
  in_parallel(registry.size(), [&](std::size_t e) {
    const Effect* effect = registry[e];
    const bool named = std::any_of(space.model().begin(), space.model().end(),
                                   [&](const ActiveEffect& active) { return active.effect == effect; });
    if (!named) typical[e] = typical_effect(space, *effect);
  });
  std::vector<TypicalEffect> effects;
  for (std::optional<TypicalEffect>& one : typical)
    if (one) effects.push_back(std::move(*one));
  return effects;
}

std::vector<Unseen> find_unseen(const Space& space, const std::vector<TypicalEffect>& effects,
                                double alarm_rate, const Rates& rates) {
  std::vector<Unseen> unseen;
  for (const TypicalEffect& typical : effects) {
    const double threshold =
        detection_threshold(alarm_rate, rates.questions(typical.active.effect->info().id));
    if (typical.noncentrality >= threshold) continue;
    Unseen entry;
    entry.effect = typical.active.effect->info().id;
    const auto [name, value] = size_of(space, typical, 1.0);
    entry.typical[name] = value;
    if (const auto factor = factor_to(space, typical, threshold))
      entry.detectable = size_of(space, typical, *factor).second;
    entry.harm_m = range_error_of(space, typical);
    if (!std::isfinite(entry.harm_m)) continue;
    entry.settled_by = settled_by(space.rows(), *typical.active.effect);
    unseen.push_back(std::move(entry));
  }
  std::stable_sort(unseen.begin(), unseen.end(),
                   [](const Unseen& a, const Unseen& b) { return a.harm_m > b.harm_m; });
  return unseen;
}

}  // namespace rangecal::diagnosis
