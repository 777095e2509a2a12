// SPDX-License-Identifier: BSD-3-Clause
// B6. The robot rolls forward during the sweep; its pose is that of the sweep's middle, when the beam
// looks ahead (b = 0).
//
//   w = m (b + delta b) / (2 pi)     [m]
//   delta d = sqrt((D - w cos b)^2 + (w sin b)^2) - D     [m]
//   delta b = atan2(w sin b, D - w cos b)     [rad]
//     w way since the middle of the sweep, by the direction in which the beam meets the landmark; m = v T way of a whole
//     sweep of T seconds; b direction in the sensor frame from the pose of the middle [rad]; D axis distance [m]
//
// The range part acts before the curve. Turning during the sweep, delta b = -omega T b / (2 pi), is the
// exact twin of bearing_scale and belongs to it. Source: derived: the sensor is w further ahead.
#include <cmath>
#include <numbers>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class SweepMotion final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "sweep_motion",
        .number = "B6",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "sensor_bearing",
        .physics =
            "The robot still rolls while the sensor sweeps: landmarks left and right are seen from different "
            "places.",
        .formula =
            "delta d = sqrt((D - w cos b)^2 + (w sin b)^2) - D [m], delta b = atan2(w sin b, D - w cos b) [rad], "
            "w = v T (b + delta b) / 2 pi, T duration of a sweep [s], v speed [m/s]",
        .source = "derived: the sensor is w further ahead",
        .visible_by = "landmarks all around the sensor",
        .settled_by = "stand still longer before reading, or drive at a second speed",
        .switched_off_by = {"E11"},
        .parameters = {{.name = "travel_m", .typical = 0.06, .low = -5.0, .high = 5.0}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double D = at.axis_distance, c = std::cos(at.bearing), s = std::sin(at.bearing);
    double way = 0.0, turn = 0.0;
    for (int i = 0; i < 4; ++i) {  // each leaves v T / (2 pi D) of the error of the one before
      way = p[0] * (at.bearing + turn) / (2.0 * std::numbers::pi);
      turn = std::atan2(way * s, D - way * c);
    }
    return {.range = at.before_curve(std::hypot(D - way * c, way * s) - D), .bearing = turn};
  }
};

}  // namespace

std::unique_ptr<Effect> make_sweep_motion() { return std::make_unique<SweepMotion>(); }

}  // namespace rangecal::effects
