// SPDX-License-Identifier: BSD-3-Clause
// B1. The zero of the bearing is wrong.
//
//   delta b = b0     [rad]
//
// Exact twin of a constant error of the heading, and of a robot that drives askew. Source: derived: a constant in every
// bearing.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class BearingOffset final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "bearing_offset",
        .number = "B1",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "constant",
        .physics =
            "All bearings are turned by one angle: the zero of the encoder, or the mounting angle, is wrong, "
            "or the robot drives askew.",
        .formula = "delta b = b0 [rad]",
        .expression = "angle",
        .source = "derived: a constant in every bearing",
        .visible_by = "a path with turns or known headings",
        .settled_by =
            "only an outside heading reference tells it from a constant heading error; harmless for the "
            "range curve",
        .exact_twins = {"heading_zero"},
        .parameters = {{.name = "angle_rad", .typical = 0.01745, .low = -3.2, .high = 3.2}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 1); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>&, const double* p) const override {
    return {.bearing = p[0]};
  }
};

}  // namespace

std::unique_ptr<Effect> make_bearing_offset() { return std::make_unique<BearingOffset>(); }

}  // namespace rangecal::effects
