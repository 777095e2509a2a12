// SPDX-License-Identifier: BSD-3-Clause
// B4. Angles are counted too fast or too slowly from the index pulse behind the sensor: a scale with a
// seam at +-pi.
//
//   delta b = gamma b     [rad], b direction in the sensor frame in (-pi, pi] [rad]
//
// Exact twin of a robot that turns during the sweep. A ripple of the motor's speed once per turn is
// encoder_eccentricity. Source: derived; YDLidar communication protocol (angles interpolated inside a packet).
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class BearingScale final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "bearing_scale",
        .number = "B4",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "sensor_bearing",
        .physics =
            "Bearings are stretched from the front to a seam behind the sensor: angles counted or "
            "interpolated at a wrong speed, or the robot turns during the sweep.",
        .formula = "delta b = gamma b [rad], b in (-pi, pi] [rad], seam at +-pi",
        .expression = "scale*b",
        .source = "derived; YDLidar communication protocol (angles interpolated inside a packet)",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by =
            "turn the sensor at each stop (0, 90, 180, 270 degrees); place a landmark behind the robot; run "
            "the motor at a second speed",
        .parameters = {{.name = "scale", .typical = 0.005, .low = -0.9, .high = 0.9}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.bearing = p[0] * at.bearing};
  }
};

}  // namespace

std::unique_ptr<Effect> make_bearing_scale() { return std::make_unique<BearingScale>(); }

}  // namespace rangecal::effects
