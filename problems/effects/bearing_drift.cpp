// SPDX-License-Identifier: BSD-3-Clause
// B1, drifting. The zero of the bearing moves evenly in time.
//
//   delta b = b1 t     [rad], t time scaled to 0 .. 1 over the recording, b1 [rad per run]
//
// Exact twin of heading_drift with b1 = -h. Source: derived: a zero that moves evenly in time.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class BearingDrift final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "bearing_drift",
        .number = "B1",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "time",
        .physics =
            "Bearings turn evenly in the course of the recording: the zero of the encoder creeps, or the "
            "robot turns where it stands.",
        .formula = "delta b = b1 t [rad], t time scaled to 0 .. 1 over the recording",
        .expression = "angle*t/duration",
        .source = "derived: a zero that moves evenly in time",
        .visible_by = "drive the same stops again in reverse order",
        .settled_by =
            "only an outside heading reference tells it from heading_drift; harmless for the range curve",
        .over_the_recording = true,
        .exact_twins = {"heading_drift"},
        .parameters = {{.name = "angle_rad", .typical = 0.01745, .low = -1.5, .high = 1.5}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 2), lacks_times(context));
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.bearing = p[0] * at.time};
  }
};

}  // namespace

std::unique_ptr<Effect> make_bearing_drift() { return std::make_unique<BearingDrift>(); }

}  // namespace rangecal::effects
