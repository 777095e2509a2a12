// SPDX-License-Identifier: BSD-3-Clause
// B2. The beam does not pass through the spin axis, but at distance q from it; psi0 is its squint.
//
//   delta b = psi0 - asin(q / D)     [rad], q [m], D distance to the landmark's axis [m]
//
// The hits lie evenly about the direction in which the beam's line passes through the landmark's axis, so
// D = d + R stands where the makers' corrections, made for single hits, have the range. Linear in q to 1 %
// for q < D / 4. Source: Slamtec rplidar_sdk capsule unpacker, YDLidar communication protocol.
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class BeamOffset final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "beam_offset",
        .number = "B2",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "disparity",
        .physics =
            "Near landmarks appear turned against far ones: the beam passes beside the spin axis and the "
            "driver does not correct it.",
        .formula =
            "delta b = psi0 - asin(q / D) [rad], q offset of the beam [m], psi0 squint [rad], D axis "
            "distance [m]",
        .expression = "squint - asin(max(-1, min(1, offset/(d + radius))))",
        .source = "Slamtec rplidar_sdk capsule unpacker, YDLidar communication protocol",
        .visible_by = "near landmarks (under 1 m) together with far ones",
        .settled_by =
            "read the driver's own bearing correction, and place landmarks at 0.3-0.6 m and at the far end",
        .parameters = {{.name = "offset_m", .typical = 0.022, .low = -1.0, .high = 1.0},
                       {.name = "squint_rad", .typical = 0.01745, .low = -1.5, .high = 1.5}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.bearing = p[1] - std::asin(std::clamp(p[0] / at.axis_distance, -1.0, 1.0))};
  }
};

}  // namespace

std::unique_ptr<Effect> make_beam_offset() { return std::make_unique<BeamOffset>(); }

}  // namespace rangecal::effects
