// SPDX-License-Identifier: BSD-3-Clause
// N4. Readings are smoothed, or their noise is serially correlated: AR(1) over the repeats of a (stop,
// landmark).
//
//   e_i = rho e_(i-1) + sqrt(1 - rho^2) w_i
//     rho for range and for bearing [-]; variance of a mean times (1 + rho) / (1 - rho)
//
// Known distances read on the way, none twice, follow one another by device and in order of time. What their errors share is
// rarely all of the noise (multipath, a pose that is off for a while), and gaps differ:
//
//   e_i = sqrt(q) x_i + sqrt(1 - q) w_i,   corr(x_i, x_(i-1)) = rho^(gap_i / usual gap)
//     q = share of the variance [-]
//
// Source: derived: first-order autoregression from reading to reading (an Ornstein-Uhlenbeck process where gaps differ).
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

bool is_sequence(const EffectContext& context) { return context.longest_sequence > 0; }

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
            "Readings taken one after another share part of their errors (a filter in the driver, an error that "
            "wanders), so they count for less than they seem.",
        .formula =
            "e_i = rho e_(i-1) + sqrt(1 - rho^2) w_i over the repeats, rho for range and for bearing; of known "
            "distances read on the way a share of the noise, rho over the usual gap",
        .source = "derived: first-order autoregression from reading to reading",
        .visible_by = "many sweeps at each stop",
        .settled_by = "200 sweeps at one stop: autocorrelation and distinct values",
        .settled_of_pairs = {.changes = {"E7"}},
        .parameters = {{.name = "rho", .typical = 0.6, .low = 0.0, .high = 0.98, .linear = false},
                       {.name = "bearing_rho", .typical = 0.6, .low = 0.0, .high = 0.98, .linear = false},
                       {.name = "share", .typical = 0.5, .low = 0.0, .high = 1.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    if (is_sequence(context)) {
      const double slowest = bounds(context, 0).second;
      return {point({0.5 * slowest, 0.0, 0.9}), point({0.9 * slowest, 0.0, 0.5})};
    }
    if (context.kind == RecordingKind::pairs)
      return {point({0.3, 0.0, 1.0}), point({0.6, 0.0, 1.0}), point({0.9, 0.0, 1.0})};
    return {point({0.3, 0.0, 1.0}), point({0.6, 0.0, 1.0}), point({0.9, 0.0, 1.0}), point({0.0, 0.6, 1.0}),
            point({0.6, 0.6, 1.0})};
  }

  std::string missing(const EffectContext& context) const override {
    return is_sequence(context) ? "" : lacks_repeats(context, 3);
  }

  /// Pairs have no channel of bearings; repeats share all of their noise. In a sequence a little of it is of each reading alone,
  /// and what wanders more slowly than a twentieth of the sequence is a drift, no noise.
  std::pair<double, double> bounds(const EffectContext& context, std::size_t parameter) const override {
    if (parameter == 1 && context.kind == RecordingKind::pairs) return {0.0, 0.0};
    if (!is_sequence(context))
      return parameter == 2 ? std::pair(1.0, 1.0) : Effect::bounds(context, parameter);
    return {0.0, parameter == 2 ? 0.99 : std::exp(-20.0 / context.longest_sequence)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    if (is_sequence(context)) return {{"rho", p[0]}, {"share", p[2]}};
    if (context.kind == RecordingKind::pairs) return {{"rho", p[0]}};
    return {{"rho", p[0]}, {"bearing_rho", p[1]}};
  }

  Dependence dependence(const double* p) const override {
    return {.range_correlation = p[0], .range_correlated_share = p[2], .bearing_correlation = p[1]};
  }
};

}  // namespace

std::unique_ptr<Effect> make_autocorrelated_noise() { return std::make_unique<AutocorrelatedNoise>(); }

}  // namespace rangecal::effects
