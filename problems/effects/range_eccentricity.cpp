// SPDX-License-Identifier: BSD-3-Clause
// R14. The reading depends on the direction in the sensor frame: a cover or mirror that is not concentric.
//
//   delta r = e_c cos b + e_s sin b     [m], b the direction in the sensor frame [rad]
//
// Acts on the reading, after the curve. Source: derived: first harmonic of the optical path over the direction.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class RangeEccentricity final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "range_eccentricity",
        .number = "R14",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "sensor_bearing",
        .physics =
            "The range depends on the direction in the sensor frame once per turn: a cover, window or mirror is "
            "not concentric with the spin axis.",
        .formula = "delta r = e_c cos b + e_s sin b [m]",
        .expression = "cosine*cos(b) + sine*sin(b)",
        .source = "derived: first harmonic of the optical path over the direction",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by = "record near and far landmarks in the same direction, at several headings",
        .settled_of_pairs = {.changes = {"E1"}},
        .parameters = {{.name = "cosine_m", .typical = 0.0075, .low = -10.0, .high = 10.0},
                       {.name = "sine_m", .typical = 0.0075, .low = -10.0, .high = 10.0}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_directions(context); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = p[0] * std::cos(at.bearing) + p[1] * std::sin(at.bearing)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"amplitude_m", std::hypot(p[0], p[1])}, {"phase_rad", std::atan2(p[1], p[0])}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_range_eccentricity() { return std::make_unique<RangeEccentricity>(); }

}  // namespace rangecal::effects
