// SPDX-License-Identifier: BSD-3-Clause
#include "noncentrality.hpp"

#include <algorithm>
#include <cmath>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/plants.hpp"

namespace rangecal::proof {

double noncentrality(const SeedModel& model, const world::World& planted, const Eigen::Vector3d* held_alpha) {
  return model.fit(world::expected(planted), held_alpha).residual.squared_norm();
}

double noncentrality(const world::World& clean) { return noncentrality(SeedModel(clean), clean); }

Signal projected(const SeedModel& model, const world::World& planted) {
  Signal out = model.fit(world::expected(planted)).residual;
  out.means = model.project(out.means);
  return out;
}

std::optional<Sized> size_for(const SeedModel& model, const std::string& id, double target, Measure measure,
                              std::uint64_t seed, double sign, const Eigen::Vector3d* held_alpha) {
  const world::EffectInfo& info = world::effect_info(id);
  const auto at = [&](double size) {
    Random random(seed);
    Sized out{sign * size, 0.0, world::apply(model.clean(), id, sign * size, random)};
    out.value = measure == Measure::lambda ? noncentrality(model, out.planted, held_alpha)
                                           : oracle_nats(model, out.planted);
    return out;
  };
  Sized high = at(info.maximum);
  if (!(high.value >= target)) return std::nullopt;
  // log(value) against log(size) is nearly a straight line: regula falsi there, with bisection where it stalls.
  double low_size = 1e-3 * info.maximum, high_size = info.maximum;
  Sized low = at(low_size);
  if (low.value >= target) return low;
  double low_log = std::log(std::max(low.value, 1e-12) / target), high_log = std::log(high.value / target);
  Sized best = high;
  for (int round = 0; round < 40; ++round) {
    const double a = std::log(low_size), b = std::log(high_size);
    double share = -low_log / (high_log - low_log);
    if (round % 3 == 2) share = 0.5;
    const Sized middle = at(std::exp(a + std::clamp(share, 0.02, 0.98) * (b - a)));
    const double off = std::log(std::max(middle.value, 1e-12) / target);
    if (std::abs(off) < std::abs(std::log(best.value / target))) best = middle;
    if (std::abs(off) < 0.01) return best;
    if (off < 0.0)
      low_size = std::abs(middle.size), low_log = off;
    else
      high_size = std::abs(middle.size), high_log = off;
    if (high_size / low_size < 1.0 + 1e-9) break;  // a step: the size that just passes it
  }
  return std::abs(std::log(best.value / target)) < 0.05 ? std::optional<Sized>(best) : std::nullopt;
}

}  // namespace rangecal::proof
