// SPDX-License-Identifier: BSD-3-Clause
// N1. The spread follows another law of the distance than the one fitted.
//
//   log s^2 -> log s^2 + g1 u + g2 u^2,   u = log(f / f0)
//     f reading [m], f0 geometric middle of the ranges [m]
//
// g1 changes the exponent of the spread by g1 / 2; g2 bends it: a floor near, photon or background noise
// far. The level is in the fitted law. Source: derived: speckle d^2, shot d^3, background d^4; Dorsch, Haeusler and
// Herrmann 1994; exponents 0, 2, 3, 4.
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class NoiseLaw final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "noise_law",
        .number = "N1",
        .kind = EffectKind::noise,
        .channel = "range_noise",
        .covariate = "range",
        .physics =
            "The spread grows with distance by another law than the one fitted: a floor, photon or "
            "background noise.",
        .formula =
            "log variance + g1 u + g2 u^2, u = log(f / f0), f0 geometric middle of the ranges [m]; spread "
            "exponent + g1 / 2",
        .source = "derived: speckle d^2, shot d^3, background d^4; Dorsch, Haeusler and Herrmann 1994",
        .visible_by = "repeats at four or more well-spread ranges",
        .settled_by = "200 sweeps at one near, one middle and one far stop; record intensity as a column",
        .settled_of_pairs = {.changes = {"E7"}},
        .parameters = {{.name = "slope", .typical = 2.0, .low = -8.0, .high = 8.0},
                       {.name = "bend", .typical = 1.0, .low = -4.0, .high = 4.0}}};
    return value;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double middle = at.context != nullptr && at.context->range_min_m > 0.0
                              ? std::sqrt(at.context->range_min_m * at.context->range_max_m)
                              : 1.0;
    const double u = std::log(std::max(at.f, 1e-3) / middle);
    return {.range_log_variance = u * (p[0] + p[1] * u)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"spread_exponent", 0.5 * p[0]}, {"spread_bend", 0.5 * p[1]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_noise_law() { return std::make_unique<NoiseLaw>(); }

}  // namespace rangecal::effects
