// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/training_part.hpp"

#include <algorithm>
#include <cmath>

#include "diagnosis/subset.hpp"

namespace rangecal::diagnosis {
namespace {

/// Parameters of dependence and tails, which have no score: one parabola through three values of l_s, the
/// rest held.
void fit_numeric(const Rows& rows, const Fit& full, Model& model, const JointState& state) {
  for (const FreeParameter& p : full.free) {
    if (p.acts != FreeParameter::Acts::numeric) continue;
    const EffectParameter& info = model[p.effect].effect->info().parameters[p.index];
    double& value = model[p.effect].parameters[p.index];
    const double centre = value, step = 0.2 * std::max(std::abs(centre), 0.2 * info.typical);
    const auto at = [&](double x) {
      value = std::clamp(x, info.low, info.high);
      JointState trial = state;
      return laplace_value(rows, model, trial);
    };
    const double low = at(centre - step), high = at(centre + step), middle = at(centre);
    const double curvature = low - 2.0 * middle + high;
    const double shift = curvature > 0.0 ? std::clamp(0.5 * (low - high) / curvature, -2.0, 2.0) : 0.0;
    const double there = at(centre + shift * step);
    if (!(there <= middle)) value = centre;
  }
}

}  // namespace

HeldOut sum_of(const std::vector<HeldOut>& parts) {
  HeldOut all;
  for (const HeldOut& held : parts) {
    all.nll += held.nll;
    all.parts.insert(all.parts.end(), held.parts.begin(), held.parts.end());
    all.ok = all.ok && held.ok;
  }
  return all;
}

Fit fit_part(const Rows& rest, const Fit& full, RefitOptions options, int iterations) {
  const bool numeric = std::any_of(full.free.begin(), full.free.end(), [](const FreeParameter& p) {
    return p.acts == FreeParameter::Acts::numeric;
  });
  options.max_iterations = iterations;
  if (!numeric) return refit(rest, full.model, full.state, options);
  Fit fit = full;
  fit_numeric(rest, full, fit.model, full.state);
  const bool others = std::any_of(full.free.begin(), full.free.end(), [](const FreeParameter& p) {
    return p.acts != FreeParameter::Acts::numeric;
  });
  if (others) {
    options.settled = static_cast<int>(fit.model.size());
    return refit(rest, fit.model, fit.state, options);
  }
  fit.nll = calibrate_under(rest, fit.model, fit.state, options);
  fit.ok = std::isfinite(fit.nll);
  return fit;
}

}  // namespace rangecal::diagnosis
