// SPDX-License-Identifier: BSD-3-Clause
// N4. Readings are smoothed, or their noise is serially correlated: AR(1) over the repeats of a (stop,
// landmark).
//
//   e_i = rho e_(i-1) + sqrt(1 - rho^2) w_i
//     rho for range and for bearing [-]; variance of a mean times (1 + rho) / (1 - rho)
//
// Source: derived: first-order autoregression from reading to reading.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class AutocorrelatedNoise final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "autocorrelated_noise",
        .number = "N4",
        .kind = EffectKind::dependence,
        .channel = "range_dependence",
        .covariate = "repeat",
        .physics =
            "Successive readings hang together: the driver smooths them, so repeats count for less than they "
            "seem.",
        .formula = "e_i = rho e_(i-1) + sqrt(1 - rho^2) w_i over the repeats, rho for range and for bearing",
        .source = "derived: first-order autoregression from reading to reading",
        .visible_by = "many sweeps at each stop",
        .settled_by = "200 sweeps at one stop: autocorrelation and distinct values",
        .parameters = {{.name = "rho", .typical = 0.6, .low = 0.0, .high = 0.98, .linear = false},
                       {.name = "bearing_rho", .typical = 0.6, .low = 0.0, .high = 0.98, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    if (context.kind == RecordingKind::pairs)
      return {point({0.3, 0.0}), point({0.6, 0.0}), point({0.9, 0.0})};
    return {point({0.3, 0.0}), point({0.6, 0.0}), point({0.9, 0.0}), point({0.0, 0.6}), point({0.6, 0.6})};
  }

  std::string missing(const EffectContext& context) const override { return lacks_repeats(context, 3); }

  /// Pairs have no channel of bearings.
  std::pair<double, double> bounds(const EffectContext& context, std::size_t parameter) const override {
    const bool silent = context.kind == RecordingKind::pairs && parameter == 1;
    return silent ? std::pair(0.0, 0.0) : Effect::bounds(context, parameter);
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    if (context.kind == RecordingKind::pairs) return {{"rho", p[0]}};
    return Effect::reported(context, p);
  }

  Dependence dependence(const double* p) const override {
    return {.range_correlation = p[0], .bearing_correlation = p[1]};
  }
};

}  // namespace

std::unique_ptr<Effect> make_autocorrelated_noise() { return std::make_unique<AutocorrelatedNoise>(); }

}  // namespace rangecal::effects
