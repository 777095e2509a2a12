// SPDX-License-Identifier: BSD-3-Clause
// B6. The robot rolls forward during the sweep; its pose is that of the sweep's middle, when the beam
// looks ahead (b = 0).
//
//   u = m b / (2 pi)     [m]
//   delta d = -u cos b     [m]
//   delta b = u sin b / D     [rad]
//     way since the middle of the sweep, m = v T way of a whole sweep of T seconds; b direction in the
//     sensor frame [rad]; D axis distance [m]
//
// The range part acts before the curve. Turning during the sweep, delta b = -omega T b / (2 pi), is the
// exact twin of bearing_scale and belongs to it. Source: derived: delta r = -v cos b (t_i - t_0).
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
        .channel = "range",
        .covariate = "sensor_bearing",
        .physics =
            "The robot still rolls while the sensor sweeps: landmarks left and right are seen from different "
            "places.",
        .formula =
            "delta d = -v T (b / 2 pi) cos b [m], delta b = v T (b / 2 pi) sin b / D [rad], T duration of a "
            "sweep [s], v speed [m/s]",
        .source = "derived: delta r = -v cos b (t_i - t_0)",
        .visible_by = "landmarks all around the sensor",
        .settled_by = "stand still longer before reading, or drive at a second speed",
        .switched_off_by = {"E11"},
        .parameters = {{.name = "travel_m", .typical = 0.06, .low = -5.0, .high = 5.0}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double way = p[0] * at.bearing / (2.0 * std::numbers::pi);
    return {.range = at.before_curve(-way * std::cos(at.bearing)),
            .bearing = way * std::sin(at.bearing) / at.axis_distance};
  }
};

}  // namespace

std::unique_ptr<Effect> make_sweep_motion() { return std::make_unique<SweepMotion>(); }

}  // namespace rangecal::effects
