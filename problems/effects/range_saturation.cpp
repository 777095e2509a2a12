// SPDX-License-Identifier: BSD-3-Clause
// R19. A bias that grows with distance and levels off: the received signal falls until the receiver's gain no longer follows.
//
//   delta r = A (1 - exp(-d / D))     [m]
//     A bias far away [m], D distance by which 63 % of it are there [m]
//
// Acts on the reading, after the curve, whose slope takes it up where the distances span less than D. Radio signals fade over
// metres: within a few of them the curve leaves too little of it to be told from anything else that levels off, so that
// distances over 10 m are asked for. Source: by definition; range bias by received power of ultra-wideband radios: Decawave
// APS011, 2014.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class RangeSaturation final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "range_saturation",
        .number = "R19",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "range",
        .physics =
            "The readings are too long, or too short, by an amount that grows with distance and levels off: a "
            "receiver that follows the falling signal so far and no further.",
        .formula = "delta r = A (1 - exp(-d / D)) [m], A bias far away [m], D [m]",
        .source =
            "by definition; range bias by received power of ultra-wideband radios: Decawave APS011, 2014",
        .visible_by = "distances from near to several times D",
        .settled_by = "put an attenuator of 6 dB before the antenna: power falls, distance stays",
        .parameters = {{.name = "limit_m", .typical = 0.4, .low = -20.0, .high = 20.0},
                       {.name = "reach_m", .typical = 15.0, .low = 5.0, .high = 200.0, .linear = false}}};
    return value;
  }

  /// Beyond half the longest distance the change is a parabola to a hundredth, and the curve's.
  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    const EffectParameter& reach = info().parameters[1];
    const double far = std::clamp(0.5 * context.range_max_m, 2.0 * reach.low, reach.high);
    return grid_of({{0.0}, even_ratios(std::max(1.01 * reach.low, far / 16.0), far, 9)});
  }

  std::string missing(const EffectContext& context) const override {
    constexpr double least_span_m = 10.0;
    return context.range_max_m - context.range_min_m >= least_span_m
               ? ""
               : "distances over a long span: 10 m from the nearest to the farthest";
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = p[0] * -std::expm1(-at.d / p[1])};
  }
};

}  // namespace

std::unique_ptr<Effect> make_range_saturation() { return std::make_unique<RangeSaturation>(); }

}  // namespace rangecal::effects
