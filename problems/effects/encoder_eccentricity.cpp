// SPDX-License-Identifier: BSD-3-Clause
// B3. The encoder disc or magnet is off the spin axis: first harmonic.
//
//   delta b = A sin(b - psi) = s sin b + c cos b [rad], A = e / r_enc of the disc
//
// b is the direction in the sensor frame [rad], psi the phase.
//
// Source: derived: geometry of an eccentric or stretched disc.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class EncoderEccentricity final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "encoder_eccentricity",
        .number = "B3",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "sensor_bearing",
        .physics =
            "Bearings are off by an angle that depends on the direction in the sensor frame once per turn: "
            "the encoder disc or magnet is eccentric.",
        .formula = "delta b = A sin(b - psi) = s sin b + c cos b [rad], A = e / r_enc of the disc",
        .expression = "sin_*sin(b) + cos_*cos(b)",
        .source = "derived: geometry of an eccentric or stretched disc",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .parameters = {{.name = "sin_rad", .typical = 0.00873, .low = -1.5, .high = 1.5},
                       {.name = "cos_rad", .typical = 0.00873, .low = -1.5, .high = 1.5}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.bearing = p[0] * std::sin(at.bearing) + p[1] * std::cos(at.bearing)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"amplitude_rad", std::hypot(p[0], p[1])},
            {"phase_rad", std::atan2(-p[1], p[0])},
            {"sin_rad", p[0]},
            {"cos_rad", p[1]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_encoder_eccentricity() { return std::make_unique<EncoderEccentricity>(); }

}  // namespace rangecal::effects
