// SPDX-License-Identifier: BSD-3-Clause
// B3. The encoder is stretched, or its axis wobbles: second harmonic.
//
//   delta b = A sin 2(b - psi) = s sin 2b + c cos 2b [rad]
//
// b is the direction in the sensor frame [rad], psi the phase.
//
// Source: derived: geometry of an eccentric or stretched disc.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class EncoderEllipticity final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "encoder_ellipticity",
        .number = "B3",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "sensor_bearing",
        .physics =
            "Bearings are off by an angle that depends on the direction in the sensor frame twice per turn: "
            "the encoder ring is stretched or its axis wobbles.",
        .formula = "delta b = A sin 2(b - psi) = s sin 2b + c cos 2b [rad]",
        .expression = "sin_*sin(2*b) + cos_*cos(2*b)",
        .source = "derived: geometry of an eccentric or stretched disc",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .parameters = {{.name = "sin_rad", .typical = 0.00524, .low = -1.5, .high = 1.5},
                       {.name = "cos_rad", .typical = 0.00524, .low = -1.5, .high = 1.5}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.bearing = p[0] * std::sin(2.0 * at.bearing) + p[1] * std::cos(2.0 * at.bearing)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"amplitude_rad", std::hypot(p[0], p[1])},
            {"phase_rad", 0.5 * std::atan2(-p[1], p[0])},
            {"sin_rad", p[0]},
            {"cos_rad", p[1]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_encoder_ellipticity() { return std::make_unique<EncoderEllipticity>(); }

}  // namespace rangecal::effects
